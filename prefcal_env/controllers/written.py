"""Write a PID as other control systems take it: its numbers by form, structured text, and C."""

import re
from dataclasses import dataclass
from math import inf, isfinite, sqrt
from string import Template

from prefcal_env import units
from prefcal_env.errors import SettingsError

from .pid import PID

# --- The numbers, in the forms that control systems use.


@dataclass(frozen=True, slots=True)
class Number:
    """A number to type in: its symbol, value and unit, and what it is."""

    symbol: str
    value: float
    unit: str
    about: str


@dataclass(frozen=True, slots=True)
class Form:
    """A form of the PID, with the numbers that make it the same controller.

    `numbers` is empty where the form has none; then `lacks` says why.
    """

    name: str
    equation: str
    numbers: tuple[Number, ...]
    lacks: str = ""


def forms(pid: PID, *, gain: str = "", time: str = "s", span: float | None = None) -> tuple[Form, ...]:
    """Return the PID in standard, parallel and series form, and in percent of the ranges.

    Source: Åström, Hägglund (2006), Advanced PID Control, the conversions between the forms.

    Args:
        pid: PID; its times are in `time`.
        gain: Unit of K_p.
        time: Unit of its times.
        span: Range of the measured output, in its unit; None if it is not known, as then are the gain
            in percent and the proportional band. They also need finite limits of the input.

    Raises:
        SettingsError: If `time` is no unit of time, or `span` is not above 0.
    """
    p = pid.parameters
    K, T_i, T_d, T_f = p["K_p"], p["T_i"], p["T_d"], p["T_d"] / p["N"]
    standard = [
        Number("K_p", K, gain, "gain"),
        Number("T_i", T_i, time, "integral time, or time per repeat"),
        Number("T_d", T_d, time, "derivative time, or rate"),
        Number("N", p["N"], "", "largest gain of the derivative part, relative to K_p"),
        Number("1/T_i", 60 / _seconds(T_i, time), "1/min", "repeats per minute"),
    ]
    parallel = [
        Number("K_p", K, gain, "proportional gain"),
        Number("K_i", K / T_i, _per(gain, time), "integral gain"),
        Number("K_d", K * T_d, _times(gain, time), "derivative gain"),
        Number("T_f", T_f, time, "time constant of the derivative's filter"),
    ]
    found = [
        Form("standard (ISA, ideal)", "K_p (e + ∫e dt / T_i + T_d de/dt)", tuple(standard)),
        Form("parallel (independent gains)", "K_p e + K_i ∫e dt + K_d de/dt", tuple(parallel)),
        _series(K, T_i, T_d, gain, time),
    ]
    width = p["high"] - p["low"]
    if span is not None and not 0 < span < inf:
        raise SettingsError(f"the range of the measured output must be above 0 and finite, got {span}")
    if span is not None and isfinite(width):
        percent = K * span / width
        found.append(
            Form(
                "standard, in percent of the ranges",
                "u and y in percent of their ranges",
                (
                    Number("K", percent, "%/%", "gain"),
                    Number("PB", 100 / abs(percent), "%", "proportional band"),
                ),
            )
        )
    return tuple(found)


def _series(K: float, T_i: float, T_d: float, gain: str, time: str) -> Form:
    """Return the series form, which has real zeros only: it exists for T_d up to a quarter of T_i."""
    name, equation = "series (interacting)", "K' (1 + 1/(T_i' s)) (1 + T_d' s) e"
    if 4 * T_d > T_i:
        return Form(name, equation, (), "T_d is above a quarter of T_i, which this form cannot do")
    share = (1 + sqrt(1 - 4 * T_d / T_i)) / 2
    numbers = (
        Number("K'", K * share, gain, "gain"),
        Number("T_i'", T_i * share, time, "integral time"),
        Number("T_d'", T_d / share, time, "derivative time"),
    )
    return Form(name, equation, numbers)


def _seconds(value: float, time: str) -> float:
    known = units.conversion(time, "s")
    if known is None:
        raise SettingsError(f"the unit of time must be one such as s, min or h, got {time!r}")
    return value if value == inf else known.to(value)


def _per(gain: str, time: str) -> str:
    return f"{gain or '1'}/{time}" if "/" not in gain else f"{gain}/{time}"


def _times(gain: str, time: str) -> str:
    return f"{gain}·{time}" if gain else time


# --- The controller as a program: sample by sample what `PID.move` does.


_ABOUT = """\
Tuned with prefcal. Call it once every sampling time, $T_s $time: its constants hold for that one only.
u = K_p (b r - y + 1/T_i int(r - y) dt + T_d d(c r - y)/dt), the derivative filtered with T_d/N.
K_p = $K_p, T_i = $T_i, T_d = $T_d, N = $N, b = $b, c = $c"""

_STRUCTURED_TEXT = """\
(* $about *)
FUNCTION_BLOCK $name
VAR_INPUT
  AUTO : BOOL := TRUE; (* FALSE: U follows ACTED, and the way back is bumpless *)
  SP : LREAL; (* set point r *)
  PV : LREAL; (* measured output y *)
  ACTED : LREAL; (* input that acted since the last call: the read-back of the actuator, or U *)
END_VAR
VAR_OUTPUT
  U : LREAL; (* input *)
END_VAR
VAR CONSTANT
  K : LREAL := $gain;
  B : LREAL := $weight_p; (* set-point weight of the proportional part *)
  C : LREAL := $weight_d; (* set-point weight of the derivative part *)
  PER_SAMPLE : LREAL := $integral; (* K_p T_s / T_i *)
  TRACKING : LREAL := $tracking; (* share of what the limits cut off that leaves the integral at once *)
  POLE : LREAL := $pole; (* T_d / (T_d + N T_s) *)
  RISE : LREAL := $rise; (* K_p N *)
  LOW : LREAL := $low;
  HIGH : LREAL := $high;
END_VAR
VAR
  running : BOOL := FALSE;
  last_sp : LREAL := 0.0;
  last_pv : LREAL := 0.0;
  integral : LREAL := 0.0;
  derivative : LREAL := 0.0;
  wanted : LREAL := 0.0;
  before : LREAL := 0.0;
END_VAR
IF NOT AUTO THEN
  running := FALSE;
  U := ACTED;
  RETURN;
END_IF;
IF NOT running THEN
  (* as if the loop had been at rest with the last input *)
  running := TRUE;
  last_sp := PV;
  last_pv := PV;
  derivative := 0.0;
  integral := ACTED - K * (B * PV - PV);
ELSE
  integral := integral + PER_SAMPLE * (last_sp - last_pv);
  integral := integral + TRACKING * (ACTED - wanted); (* anti-windup by back-calculation *)
END_IF;
before := C * last_sp - last_pv;
last_sp := SP;
last_pv := PV;
derivative := POLE * (derivative + RISE * (C * SP - PV - before));
wanted := K * (B * SP - PV) + integral + derivative;
U := LIMIT(LOW, wanted, HIGH);
END_FUNCTION_BLOCK
"""

_C = """\
/* $about */
typedef struct {
    int running;
    double last_sp, last_pv, integral, derivative, wanted;
} ${name}_state; /* all zeros at the start */

/* automatic: 0 hands acted through, and the way back is bumpless. sp, pv: set point and measured output.
   acted: input that acted since the last call, as read back from the actuator, or what this returned. */
double $name(${name}_state *m, int automatic, double sp, double pv, double acted)
{
    const double k = $gain;
    const double b = $weight_p, c = $weight_d; /* set-point weights */
    const double per_sample = $integral; /* K_p T_s / T_i */
    const double tracking = $tracking; /* share of what the limits cut off that leaves the integral at once */
    const double pole = $pole; /* T_d / (T_d + N T_s) */
    const double rise = $rise; /* K_p N */
    const double low = $low, high = $high;
    double before;
    if (!automatic) {
        m->running = 0;
        return acted;
    }
    if (!m->running) { /* as if the loop had been at rest with the last input */
        m->running = 1;
        m->last_sp = m->last_pv = pv;
        m->derivative = 0.0;
        m->integral = acted - k * (b * pv - pv);
    } else {
        m->integral += per_sample * (m->last_sp - m->last_pv);
        m->integral += tracking * (acted - m->wanted); /* anti-windup by back-calculation */
    }
    before = c * m->last_sp - m->last_pv;
    m->last_sp = sp;
    m->last_pv = pv;
    m->derivative = pole * (m->derivative + rise * (c * sp - pv - before));
    m->wanted = k * (b * sp - pv) + m->integral + m->derivative;
    return m->wanted < low ? low : m->wanted > high ? high : m->wanted;
}
"""

_RESERVED = (
    " auto break case char const continue default do double else enum extern float for goto if inline int "
    "long register restrict return short signed sizeof static struct switch typedef union unsigned void "
    "volatile while program function function_block var end_var real lreal bool true false and or xor not "
    "mod of to by then elsif repeat until exit type array string time date action step transition "
)
"""Words of C or of structured text, where upper and lower case are the same."""
_WIDEST = 1e300  # stands for no limit, which structured text has no number for


def structured_text(pid: PID, name: str = "TunedPID", *, time: str = "s") -> str:
    """Return a function block of IEC 61131-3 structured text that does what the PID does.

    Raises:
        SettingsError: If `name` is no name in C and in structured text.
    """
    return _filled(_STRUCTURED_TEXT, pid, name, time)


def c_code(pid: PID, name: str = "tuned_pid", *, time: str = "s") -> str:
    """Return C (C99), without allocation or a library, that does what the PID does.

    Raises:
        SettingsError: If `name` is no name in C and in structured text.
    """
    return _filled(_C, pid, name, time)


def _filled(template: str, pid: PID, name: str, time: str) -> str:
    plain = re.fullmatch(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*", name)
    if plain is None or f" {name.lower()} " in _RESERVED:
        raise SettingsError(
            "the name of a controller's code must be letters, digits and single underscores, start with a "
            f"letter, and be no word of C or structured text, got {name!r}"
        )
    p, law = pid.parameters, pid.law
    shown = {n: f"{p[n]:.6g}" for n in ("T_s", "K_p", "T_i", "T_d", "N", "b", "c")}
    constants = {
        "gain": law.K_p,
        "weight_p": p["b"],
        "weight_d": p["c"],
        "integral": law.integral,
        # An integral that is off stays where the start has put it.
        "tracking": pid.tracking if isfinite(p["T_i"]) else 0.0,
        "pole": law.pole,
        "rise": law.rise,
        "low": max(p["low"], -_WIDEST),
        "high": min(p["high"], _WIDEST),
    }
    about = Template(_ABOUT).substitute(shown, time=time)
    numbers = {key: _number(value) for key, value in constants.items()}
    return Template(template).substitute(numbers, name=name, about=about)


def _number(value: float) -> str:
    """Return a number with all of its digits, as both languages read it."""
    # `repr` is the shortest text that is the same number again; an exponent alone is no real in ST.
    mantissa, e, exponent = repr(float(value)).partition("e")
    return f"{mantissa}{'' if '.' in mantissa else '.0'}{e}{exponent}"
