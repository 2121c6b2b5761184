"""Write a controller as a program that control systems take: structured text and C."""

import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from string import Template
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from prefcal_env import units
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Channel, Channels, Controller
from prefcal_env.plants.systems import held

from .lqr import LQG, LQR
from .pid import PID, Decentralized
from .stored import kind_of

if TYPE_CHECKING:
    from prefcal_env.mpc import LinearMPC

# --- The controller as a program: sample by sample what `move` does.

LANGUAGES: Mapping[str, str] = {"st": "IEC 61131-3 structured text", "c": "C (C99)"}
"""Languages of `as_code`, by the word for each."""
_WRITES: Mapping[str, tuple[str, ...]] = {
    "PID": ("st", "c"),
    "Decentralized": ("st", "c"),
    "LQR": ("c",),
    "LQG": ("c",),
    "LinearMPC": ("c",),
}
_WIDEST = 1e38  # stands for no limit, which neither language has a number for; a REAL can hold it, too


def languages_of(settings: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the languages of `as_code` for the controller that `settings` describe; () if there are none."""
    kind = str(settings.get("controller"))
    described = kind != "LinearMPC" or "model" in settings  # else a scenario's own word for what it makes
    return _WRITES.get(kind, ()) if described else ()


def as_code(
    controller: Controller, language: str, channels: Channels, *, name: str = "tuned", about: str = ""
) -> str:
    """Return a program that does at every sampling instant what the controller does.

    A PID becomes a function block of IEC 61131-3 structured text or a C function; several PIDs, one each;
    LQR, LQG and the MPC of a linear plant, a C function. All memory is fixed, and C needs no library; the
    MPC needs that of math.h (-lm).

    Args:
        controller: PID, `Decentralized`, `LQR`, `LQG` or `LinearMPC`.
        language: "st" for structured text, "c" for C99.
        channels: What its outputs, inputs and states are called, and the unit of time, for comments.
        name: Name of the function block or function.
        about: Where the controller is from, for the first comment.

    Raises:
        SettingsError: If the controller cannot be written in this language, or `name` is no name in both.
    """
    if language not in LANGUAGES:
        raise SettingsError(f"a controller can be written in {sorted(LANGUAGES)}, got {language!r}")
    _check_name(name, controller)
    if isinstance(controller, PID):
        return _pid(controller, language, channels, name, about)
    if isinstance(controller, Decentralized):
        each = enumerate(controller.pids, start=1)
        return "\n".join(_pid(pid, language, channels, f"{name}_{i}", about) for i, pid in each)
    if language != "c":
        raise SettingsError("structured text is for PIDs; an LQR, LQG or MPC is written in C only")
    if isinstance(controller, LQR | LQG):
        return _lqr(controller, channels, name, about)
    if _is_mpc(controller):
        return _mpc(controller, channels, name, about)
    raise SettingsError(
        f"a controller of type {type(controller).__name__} cannot be written as code: PID, LQR, LQG and "
        "LinearMPC can"
    )


def _is_mpc(controller: Controller) -> "TypeGuard[LinearMPC]":
    return type(controller).__name__ == "LinearMPC" and isinstance(controller, kind_of("LinearMPC") or ())


_TYPES = (
    "bool byte word dword lword sint int dint lint usint uint udint ulint real lreal time ltime date ldate "
    "tod ltod dt ldt time_of_day date_and_time string wstring char wchar bcd"
)
_WORDS = (
    # C, and C++, which reads the header, too
    "alignas alignof and and_eq asm atomic auto bitand bitor break case catch char8_t char16_t char32_t "
    "class co_await co_return co_yield compl concept const const_cast consteval constexpr constinit "
    "continue decltype default delete do double dynamic_cast else enum errno explicit export extern false "
    "float for friend goto if inline int long main mutable namespace new noexcept not not_eq null nullptr "
    "operator or or_eq private protected public register reinterpret_cast requires restrict return short "
    "signed sizeof static static_assert static_cast struct switch template this thread_local throw true "
    "try typedef typeid typename typeof union unsigned using virtual void volatile wchar_t while xor xor_eq "
    # its functions, which compilers know without a header
    "abort abs acos acosh asin asinh atan atan2 atanh calloc cbrt ceil copysign cos cosh erf erfc exit exp "
    "exp2 expm1 fabs fdim floor fma fmax fmin fmod fpclassify free frexp gamma hypot ilogb isalpha isdigit "
    "isfinite isinf isnan isnormal j0 j1 jn labs ldexp lgamma llrint llround log log10 log1p log2 logb "
    "lrint lround malloc memcpy memset modf nan nearbyint nextafter nexttoward pow printf putchar puts "
    "realloc remainder remquo rint round scalb scalbln scalbn signbit sin sinh sqrt strlen tan tanh tgamma "
    "trunc y1 yn "
    # structured text
    "abstract action any array at by configuration constant elsif exit extends f_edge final from function "
    "function_block get implements initial_step interface internal interval limit method mod non_retain of "
    "on overlap override persistent pointer priority program property r_edge read_only read_write ref "
    "ref_to reference repeat resource retain set single step super task then to transition type until var "
    "with "
    # its functions, blocks and instructions
    "add add_time and andn cal calc calcn concat concat_date_tod ctd ctu ctud delete derivative div div_time "
    "eq expt f_trig find ge gt hysteresis insert integral jmp jmpc jmpcn ld ldn le left len limit ln lt max "
    "mid min move mul mul_time mux ne orn pid r ramp replace ret retc retcn right rol ror rs rtc r_trig s "
    "sel sema shl shr sr st stn sub sub_time tof ton tp xorn"
)


def _taken(controller: Controller) -> set[str]:
    """Return the names that its program cannot have, where upper and lower case are the same."""
    texts = [_MPC]
    if isinstance(controller, PID | Decentralized):
        texts = [_STRUCTURED_TEXT, _C]
    elif isinstance(controller, LQR | LQG):
        texts = [_LQR, _ESTIMATED, _MEASURED, _REFERENCES, _SUMS, _STEPS, _CUT, _SUMMED]
    programs = "\n".join(texts).lower()
    code = re.sub(r"\(\*.*?\*\)|/\*.*?\*/|\$\{?\w+\}?\w*", "", programs, flags=re.DOTALL)
    types = _TYPES.split()
    turned = {f"{one}_to_{other}" for one in types for other in types}
    return {*types, *_WORDS.split(), *re.findall(r"[a-z]\w*", code), *turned}


# What math.h defines beside the functions in `_WORDS`: those for other floats, comparisons and constants.
_MATH = re.compile(
    rf"({'|'.join(_WORDS.split())})[fl]|is(less|greater|unordered)\w*|(m|fp|huge|math)_\w+|infinity|y0|finite|"
    "drem|significand|signgam|double_t|float_t"
)


def _check_name(name: str, controller: Controller) -> None:
    plain, low = re.fullmatch(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*", name), name.lower()
    # VAR_INPUT, END_IF and so on: systems have more of them than the standard.
    taken = low in _taken(controller) or (_is_mpc(controller) and _MATH.fullmatch(low) is not None)
    if plain is None or low.startswith(("var_", "end_")) or taken:
        raise SettingsError(
            "the name of a controller's code must be letters, digits and single underscores, start with a "
            "letter, and be no word of C or structured text and no name within the program, "
            f"got {name!r:.80}"
        )


def _comment(*lines: str) -> str:
    """Return the lines of a comment in ASCII, which every editor of a control system reads."""
    parts = (part for line in lines for part in line.splitlines())
    text = "\n   ".join(" ".join(part.split()) for part in parts if part.strip())
    for sign, ascii_ in {
        "°": "deg",
        "·": ".",
        "*": ".",
        "µ": "u",
        "Ω": "Ohm",
        "′": "'",
        "−": "-",
        "≤": "<=",
        "≥": ">=",
        "±": "+/-",
        "→": "->",
        "–": "-",
        "×": "x",
        "θ": "theta",
        "√": "sqrt",
    }.items():
        text = text.replace(sign, ascii_)
    plain = [c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c)]
    # No "?" for the others: in C, two of them and a slash may be a trigraph.
    return "".join(c if c.isascii() else "_" for c in plain)


def _time_of(channels: Channels) -> str:
    return channels.time_unit or "(the plant's unit of time)"


def _called_every(T_s: float, channels: Channels) -> str:
    """Return how often a controller is called, in seconds, too, in which tasks are set."""
    length = units.seconds(channels.time_unit)
    also = f" ({T_s * length:.6g} s)" if length not in (None, 1.0) else ""
    return f"to be called once in every sampling time of {T_s:.6g} {_time_of(channels)}{also}"


def _called(channels: Sequence[Channel], index: int, kind: str) -> str:
    """Return a channel's name and unit, for comments."""
    if index >= len(channels):
        return f"{kind} {index + 1}"
    channel = channels[index]
    return f"{channel.name} [{channel.unit}]" if channel.unit else channel.name


def _number(value: float) -> str:
    """Return a number with all of its digits, as both languages read it."""
    # `repr` is the shortest text that is the same number again; an exponent alone is no real in ST.
    mantissa, e, exponent = repr(float(min(max(value, -_WIDEST), _WIDEST))).partition("e")
    return f"{mantissa}{'' if '.' in mantissa else '.0'}{e}{exponent}"


# --- A PID in both languages.

_STRUCTURED_TEXT = """\
(* $about *)
FUNCTION_BLOCK $name
VAR_INPUT
  AUTO : BOOL := TRUE; (* FALSE: manual, U is HAND *)
  HAND : LREAL; (* what U is in manual, within the limits *)
  SP : LREAL; (* set point, in the unit of PV. It should be PV in manual, for no jump at the way back *)
  PV : LREAL; (* $pv. If it is bad, set AUTO to FALSE *)
  ACTED : LREAL; (* what acted since the last call, in the unit of U: U, or what a rate limiter made of it *)
END_VAR
VAR_OUTPUT
  U : LREAL; (* $u *)
END_VAR
VAR CONSTANT
  GAIN : LREAL := $gain; (* K_p *)
  WEIGHT_P : LREAL := $weight_p; (* b, set-point weight of the proportional part *)
  WEIGHT_D : LREAL := $weight_d; (* c, set-point weight of the derivative part *)
  PER_SAMPLE : LREAL := $integral; (* K_p T_s / T_i *)
  TRACKING : LREAL := $tracking; (* T_s / T_t: share of ACTED less what was wanted, for the integral *)
  POLE : LREAL := $pole; (* T_d / (T_d + N T_s), of the derivative filter *)
  RISE : LREAL := $rise; (* K_p N *)
  U_LOW : LREAL := $low; (* $least *)
  U_HIGH : LREAL := $high; (* $most *)
END_VAR
VAR
  running : BOOL := FALSE;
  last_sp : LREAL := 0.0;
  last_pv : LREAL := 0.0;
  i_part : LREAL := 0.0;
  d_part : LREAL := 0.0;
  wanted : LREAL := 0.0;
  before : LREAL := 0.0;
END_VAR
IF NOT AUTO THEN
  running := FALSE;
  U := HAND;
ELSE
  IF NOT running THEN
    (* as if the loop had been at rest with ACTED: U starts there, moved by what SP differs from PV *)
    running := TRUE;
    last_sp := PV;
    last_pv := PV;
    d_part := 0.0;
    i_part := ACTED - GAIN * (WEIGHT_P * PV - PV);
  ELSE
    i_part := i_part + PER_SAMPLE * (last_sp - last_pv);
    i_part := i_part + TRACKING * (ACTED - wanted); (* anti-windup by back-calculation *)
  END_IF;
  before := WEIGHT_D * last_sp - last_pv;
  last_sp := SP;
  last_pv := PV;
  d_part := POLE * (d_part + RISE * (WEIGHT_D * SP - PV - before));
  wanted := GAIN * (WEIGHT_P * SP - PV) + i_part + d_part;
  U := wanted;
END_IF;
IF U > U_HIGH THEN
  U := U_HIGH;
END_IF;
IF U < U_LOW THEN
  U := U_LOW;
END_IF;
END_FUNCTION_BLOCK
"""

_C = """\
/* $about */
#ifndef ${guard}_H
#define ${guard}_H

typedef struct {
    int running;
    double last_sp, last_pv, integral, derivative, wanted;
} ${name}_state; /* one for each loop, all zeros at the start: static ${name}_state state; */

/* Return u: $u.
   automatic: 0 is manual. Then it returns hand, within the limits.
   sp, pv: set point and $pv. If it is bad, set automatic to 0. In manual sp should be pv, for no
   jump at the way back.
   acted: what acted since the last call, in the unit of u: what this returned, or what a rate limiter
   made of it. */
static inline double $name(
    ${name}_state *m, int automatic, double hand, double sp, double pv, double acted)
{
    const double gain = $gain; /* K_p */
    const double weight_p = $weight_p, weight_d = $weight_d; /* set-point weights b and c */
    const double per_sample = $integral; /* K_p T_s / T_i */
    const double tracking = $tracking; /* T_s / T_t: share of acted less what was wanted, for the integral */
    const double pole = $pole; /* T_d / (T_d + N T_s), of the derivative filter */
    const double rise = $rise; /* K_p N */
    const double low = $low, high = $high; /* $least, $most */
    double before, u = hand;
    if (!automatic) {
        m->running = 0;
    } else {
        if (!m->running) { /* as if at rest with acted: u starts there, moved by what sp differs from pv */
            m->running = 1;
            m->last_sp = m->last_pv = pv;
            m->derivative = 0.0;
            m->integral = acted - gain * (weight_p * pv - pv);
        } else {
            m->integral += per_sample * (m->last_sp - m->last_pv);
            m->integral += tracking * (acted - m->wanted); /* anti-windup by back-calculation */
        }
        before = weight_d * m->last_sp - m->last_pv;
        m->last_sp = sp;
        m->last_pv = pv;
        m->derivative = pole * (m->derivative + rise * (weight_d * sp - pv - before));
        m->wanted = gain * (weight_p * sp - pv) + m->integral + m->derivative;
        u = m->wanted;
    }
    return u > high ? high : u < low ? low : u;
}

#endif
"""


def _pid(pid: PID, language: str, channels: Channels, name: str, about: str) -> str:
    p, law, time = pid.parameters, pid.law, _time_of(channels)
    said = {n: f"{p[n]:.6g}" for n in ("K_p", "T_i", "T_d", "N", "b", "c")}
    action = "direct action, u rises with y" if p["K_p"] < 0 else "reverse action, u falls as y rises"
    head = _comment(
        about,
        f"PID, {_called_every(p['T_s'], channels)}: its constants are for that.",
        "u = K_p (b r - y + 1/T_i int(r - y) dt + T_d d(c r - y)/dt), the derivative filtered with T_d/N.",
        f"K_p = {said['K_p']} ({action}), T_i = {said['T_i']} {time}, T_d = {said['T_d']} {time},",
        f"N = {said['N']}, b = {said['b']}, c = {said['c']}. K_p is in units of u per unit of y.",
        "It needs 64-bit floating point: with REAL, 7 digits, a slow integral may stand still."
        if language == "st"
        else "",
    )
    numbers = {
        "gain": law.K_p,
        "weight_p": p["b"],
        "weight_d": p["c"],
        "integral": law.integral,
        # An integral that is off stays where the start has put it.
        "tracking": pid.tracking if isfinite(p["T_i"]) else 0.0,
        "pole": law.pole,
        "rise": law.rise,
        "low": p["low"],
        "high": p["high"],
    }
    words = {
        "pv": _comment(f"measured output {_called(channels.y, pid.output, 'y')}"),
        "u": _comment(f"input of the plant {_called(channels.u, pid.input, 'u')}"),
        "least": "lower limit" if isfinite(p["low"]) else "no lower limit",
        "most": "upper limit" if isfinite(p["high"]) else "no upper limit",
    }
    template = Template(_STRUCTURED_TEXT if language == "st" else _C)
    written = {key: _number(value) for key, value in numbers.items()}
    return template.substitute(written, **words, name=name, guard=name.upper(), about=head)


# --- LQR and LQG in C.

_ESTIMATED = """\
    for (i = 0; i < NX; i++) { /* predict with the input that acted */
        dx[i] = 0.0;
        for (j = 0; m->running && j < NX; j++) dx[i] += A[i][j] * m->x[j];
        for (j = 0; m->running && j < NU; j++) dx[i] += B[i][j] * (acted[j] - u0[j]);
        finite = finite && dx[i] - dx[i] == 0.0;
    }
    for (i = 0; i < NX && !finite; i++) dx[i] = 0.0; /* the model diverged: start anew */
    for (i = 0; i < NY; i++) {
        e[i] = y[i] - y0[i];
        for (j = 0; j < NX; j++) e[i] -= C[i][j] * dx[j];
        for (j = 0; j < NU; j++) e[i] -= D[i][j] * (acted[j] - u0[j]);
    }
    for (i = 0; i < NX; i++) { /* correct with what was measured */
        for (j = 0; j < NY; j++) dx[i] += L[i][j] * e[j];
        m->x[i] = dx[i];
    }
    m->running = 1;
"""
_UNUSED = "    (void)m;\n"
_MEASURED = "    for (i = 0; i < NX; i++) dx[i] = x[i] - x0[i];\n"
_REFERENCES = "        for (j = 0; j < NY; j++) v += F[i][j] * (r[j] - y0[j]);\n"
_SUMS = "        for (j = 0; j < NI; j++) v -= K_I[i][j] * m->sum[j];\n"
_STEPS = """\
    for (i = 0; i < NI; i++) { /* an output without a reference (NaN) has no error to sum */
        step[i] = TIME * (y[OUT[i]] - r[OUT[i]]);
        if (step[i] != step[i]) step[i] = 0.0;
    }
"""
_CUT = """\
        if (v != u[i]) cut = 1;
        for (j = 0; j < NI; j++) back += (v - u[i]) * K_I[i][j] * step[j];
"""
_SUMMED = """\
    /* anti-windup: at a limit the sums move only if that brings the input back */
    for (i = 0; i < NI && (!cut || back > 0.0); i++) m->sum[i] += step[i];
"""
_LQR = """\
/* $about */
#ifndef ${guard}_H
#define ${guard}_H

typedef struct {
$memory} ${name}_state; /* all zeros at the start: static ${name}_state state; */

/* Write the inputs into u. r: references of the outputs$nan.
   $takes */
static inline void $name(${name}_state *m, const double *r, $arguments, double *u)
{
    enum { $sizes };
$constants
    double v, dx[NX]$more;
    int i, j$flags;
$state$steps    for (i = 0; i < NU; i++) {
        v = u0[i];
        for (j = 0; j < NX; j++) v -= K[i][j] * dx[j];
$outer        u[i] = v > high[i] ? high[i] : v < low[i] ? low[i] : v;
$cut    }
$summed}

#endif
"""


def _lqr(controller: LQR | LQG, channels: Channels, name: str, about: str) -> str:
    lqg = controller if isinstance(controller, LQG) else None
    lqr = controller if isinstance(controller, LQR) else controller.lqr
    m, sums = lqr.model, bool(lqr.integral)
    sizes = {"NX": len(m.x0), "NU": len(m.u0), "NY": len(m.y0), "NI": len(lqr.integral)}
    head = _comment(
        about,
        f"{type(controller).__name__}, {_called_every(lqr.T_s, channels)}.",
        _listed("r and y", channels.y, len(m.y0)),
        _listed("u", channels.u, len(m.u0)),
        _listed("x", channels.x, len(m.x0)),
        "In manual, call it with r = y and do not use u: then its sums of errors stand still.",
        "The way back is not bumpless.",
    )
    words = {
        "memory": _memory(sizes, filtered=lqg is not None),
        "nan": ", NaN for none" if sums else ", each a number",
        "sizes": ", ".join(f"{key} = {value}" for key, value in sizes.items() if value),
        "constants": "\n".join(_constants(lqr, lqg)),
        "outer": _SUMS if sums else _REFERENCES,
        "steps": _STEPS if sums else "",
        "cut": _CUT if sums else "",
        "summed": _SUMMED if sums else "",
        "more": (", e[NY]" if lqg else "") + (", step[NI], back = 0.0" if sums else ""),
        "flags": (", finite = 1" if lqg else "") + (", cut = 0" if sums else ""),
        "state": _ESTIMATED if lqg else _MEASURED if sums else _UNUSED + _MEASURED,
        "takes": "y: measured outputs. acted: inputs since the last call." if lqg else "x: states.",
        "arguments": "const double *y, const double *acted" if lqg else "const double *x",
    }
    if sums and not lqg:
        words["takes"] = "y: measured outputs. x: states."
        words["arguments"] = "const double *y, const double *x"
    return Template(_LQR).substitute(words, name=name, guard=name.upper(), about=head)


def _memory(sizes: Mapping[str, int], *, filtered: bool) -> str:
    """Return the members of the struct, of which C needs at least one."""
    lines = f"    int running;\n    double x[{sizes['NX']}]; /* estimate, less x0 */\n" if filtered else ""
    if sizes["NI"]:
        lines += f"    double sum[{sizes['NI']}]; /* of the errors, times the sampling time */\n"
    return lines or "    int unused; /* without integral action there is nothing to remember */\n"


def _listed(symbol: str, channels: Sequence[Channel], number: int) -> str:
    """Return what the elements of a vector are, for comments."""
    return f"{symbol}: {', '.join(_called(channels, i, symbol[0]) for i in range(number))}"


def _constants(lqr: LQR, lqg: LQG | None) -> Iterator[str]:
    """Yield the declarations of the matrices and vectors that the function needs."""
    m, sums = lqr.model, bool(lqr.integral)
    arrays = {"K": lqr.K, "u0": m.u0, "low": m.low, "high": m.high}
    if lqg is None:
        arrays["x0"] = m.x0
    else:
        A, B = held(m.A, m.B, lqr.T_s)
        arrays |= {"A": A, "B": B, "C": m.C, "D": m.D, "L": lqg.gain}
    if sums:
        arrays["K_I"] = lqr.K_i
        yield f"    static const int OUT[] = {{{', '.join(map(str, lqr.integral))}}};"
        yield f"    const double TIME = {_number(lqr.T_s)};"
    else:
        arrays["F"] = lqr.K_r
    if lqg is not None or not sums:
        arrays["y0"] = m.y0
    yield from _declared(arrays)


def _declared(arrays: Mapping[str, np.ndarray]) -> Iterator[str]:
    for name, array in arrays.items():
        shape = "".join(f"[{length}]" for length in array.shape)
        yield f"    static const double {name}{shape} = {_nested(array)};"


def _nested(array: np.ndarray) -> str:
    parts = (_nested(row) if row.ndim else _number(float(row)) for row in map(np.asarray, array))
    return f"{{{', '.join(parts)}}}"


# --- An MPC of a linear plant in C.
#
# Source: Goldfarb, Idnani (1983), as `prefcal_env.qp._active_set` has it, whose steps and tolerances these
# are: so the moves are the same also where a limit is nearly active.

_MPC = """\
/* $about */
#ifndef ${guard}_H
#define ${guard}_H

#include <math.h>

typedef struct {
    double p[$p], low[$m], high[$m], offset[$m]; /* of this step: what was measured, the limits, the rows */
    double z[$n], J[$n][$n], R[$n][$n]; /* deviations, and the factors of the active rows */
    double mu[$n], a[$n], d[$n], step[$n], back[$n];
} ${name}_state; /* room to compute in, which needs no start: static ${name}_state state; */

static inline void ${name}_turn(double *one, double *other, double c, double s)
{
    const double first = *one, second = *other;
    *one = c * first + s * second;
    *other = c * second - s * first;
}

/* Write the inputs into u. Return 0; else it is acted, held, because 1: no move keeps the limits,
   2: $most iterations were not enough, 3: a number that was given is not finite.
   automatic: 0 is manual. Then u is hand, within the limits, and nothing winds up. Back in automatic it
   starts from acted, but moves at once if r is not y: let r follow y in manual, or limit the moves.
   With 3, u may be no number: do not write it. Link with -lm.
   r: references of the outputs, constant over the horizon. x: states. acted: inputs since the last call. */
static inline int $name(${name}_state *m, int automatic, const double *hand, const double *r,
    const double *x, const double *acted, double *u)
{
    enum { $sizes };
$constants
    double sum, size, over, under, excess, largest, violation, sign, push, rise, full, partial, length, c, s;
    int i, j, k = 0, row, out, turns = 0;
    for (i = 0; i < NP; i++) {
        m->p[i] = (i < NX ? x[i] : i < NX + NU ? acted[i - NX] : r[i - NX - NU]) - BASE[i];
    }
    for (i = 0; i < NU; i++) {
        u[i] = automatic ? acted[i] : hand[i] > HIGH[i] ? HIGH[i] : hand[i] < LOW[i] ? LOW[i] : hand[i];
    }
    for (i = 0; i < NP && automatic; i++) {
        if (m->p[i] - m->p[i] != 0.0) return 3;
    }
    for (i = 0; i < NU && !automatic; i++) {
        if (u[i] - u[i] != 0.0) return 3;
    }
    if (!automatic) return 0;
    for (i = 0; i < M; i++) {
        m->offset[i] = OFFSET[i];
        for (j = 0; j < NP; j++) m->offset[i] += SLOPES[i][j] * m->p[j];
        m->low[i] = LOW[i];
        m->high[i] = HIGH[i];
        if (i < NI) { /* an input, less the last one, which may lie outside: then as near as moves reach */
            j = i % NU;
            m->low[i] -= acted[j];
            m->high[i] -= acted[j];
            if (m->low[i] > 0.0) m->low[i] = fmin(m->low[i], (i / NU + 1) * MOST_UP[j]);
            if (m->high[i] < 0.0) m->high[i] = fmax(m->high[i], (i / NU + 1) * MOST_DOWN[j]);
        }
        if (i < NU) { /* the first move is its input */
            m->low[i] = fmax(m->low[i], MOST_DOWN[i]);
            m->high[i] = fmin(m->high[i], MOST_UP[i]);
        }
    }
    for (i = 0; i < N; i++) {
        m->z[i] = 0.0;
        for (j = 0; j < N; j++) m->J[i][j] = i == j ? 1.0 : 0.0;
    }
    for (;;) {
        row = -1;
        largest = violation = 0.0;
        sign = 1.0;
        for (i = 0; i < M; i++) { /* which row is violated most? */
            sum = size = 0.0;
            for (j = 0; j < N; j++) {
                sum += G[i][j] * m->z[j];
                size += fabs(G[i][j] * m->z[j]);
            }
            over = sum - (m->high[i] - m->offset[i]);
            under = m->low[i] - m->offset[i] - sum;
            excess = over > under ? over : under;
            if (excess > ABSOLUTE + RELATIVE * size && excess > largest * NORM[i]) {
                largest = NORM[i] > 0.0 ? excess / NORM[i] : HUGE_VAL;
                row = i;
                violation = excess;
                sign = over > under ? 1.0 : -1.0;
            }
        }
        if (row < 0) break; /* none: solved */
        for (j = 0; j < N; j++) m->a[j] = -sign * G[row][j];
        push = 0.0;
        do { /* go to its limit, and drop active rows that are in the way */
            if (turns++ >= $most) return 2;
            rise = 0.0;
            for (j = 0; j < N; j++) {
                m->d[j] = 0.0;
                for (i = 0; i < N; i++) m->d[j] += m->J[i][j] * m->a[i];
                if (j >= k) rise += m->d[j] * m->d[j];
            }
            for (i = 0; i < N; i++) {
                m->step[i] = 0.0;
                for (j = k; j < N; j++) m->step[i] += m->J[i][j] * m->d[j];
            }
            partial = HUGE_VAL;
            out = -1;
            for (i = k - 1; i >= 0; i--) {
                m->back[i] = m->d[i];
                for (j = i + 1; j < k; j++) m->back[i] -= m->R[i][j] * m->back[j];
                m->back[i] /= m->R[i][i];
            }
            for (j = 0; j < k; j++) {
                if (m->back[j] > 0.0 && m->mu[j] < partial * m->back[j]) {
                    partial = m->mu[j] / m->back[j];
                    out = j;
                }
            }
            full = rise > 1e-26 * NORM[row] * NORM[row] ? violation / rise : HUGE_VAL;
            length = full < partial ? full : partial;
            if (!(length < HUGE_VAL)) return 1;
            push += length;
            for (j = 0; j < k; j++) m->mu[j] -= length * m->back[j];
            for (i = 0; i < N && full < HUGE_VAL; i++) m->z[i] += length * m->step[i];
            if (full < HUGE_VAL) violation -= length * rise;
            if (full <= partial) { /* the row is active now */
                for (j = N - 1; j > k; j--) {
                    size = hypot(m->d[j - 1], m->d[j]);
                    if (!(size > 0.0)) continue;
                    c = m->d[j - 1] / size;
                    s = m->d[j] / size;
                    m->d[j - 1] = size;
                    for (i = 0; i < N; i++) ${name}_turn(&m->J[i][j - 1], &m->J[i][j], c, s);
                }
                for (i = 0; i <= k; i++) m->R[i][k] = m->d[i];
                m->mu[k++] = push;
            } else { /* the row number out is not any more */
                for (j = out; j < k - 1; j++) {
                    m->mu[j] = m->mu[j + 1];
                    for (i = 0; i < k; i++) m->R[i][j] = m->R[i][j + 1];
                }
                for (j = out; j < k - 1; j++) {
                    size = hypot(m->R[j][j], m->R[j + 1][j]);
                    c = m->R[j][j] / size;
                    s = m->R[j + 1][j] / size;
                    for (i = j; i < k - 1; i++) ${name}_turn(&m->R[j][i], &m->R[j + 1][i], c, s);
                    for (i = 0; i < N; i++) ${name}_turn(&m->J[i][j], &m->J[i][j + 1], c, s);
                }
                k--;
            }
        } while (full > partial);
    }
    for (i = 0; i < NU; i++) {
        sum = m->offset[i];
        for (j = 0; j < N; j++) sum += G[i][j] * m->z[j];
        u[i] = acted[i] + (sum > m->high[i] ? m->high[i] : sum < m->low[i] ? m->low[i] : sum);
    }
    return 0;
}

#endif
"""


def _mpc(mpc: "LinearMPC", channels: Channels, name: str, about: str) -> str:
    qp, s = mpc.condensed(), mpc.settings
    if s.backend != "active-set":  # another solver, whose iterations are others
        raise SettingsError(f"C has the method of backend 'active-set' only, got {s.backend!r}")
    (m, n), p = qp.G.shape, len(qp.base)
    n_x, n_u, n_y = len(mpc.plant.states), len(qp.du_min), len(mpc.plant.outputs)
    sizes = {"NX": n_x, "NU": n_u, "NP": p, "NI": s.N_u * n_u, "N": n, "M": m}
    head = _comment(
        about,
        f"MPC, {_called_every(s.T_s, channels)}.",
        f"N_p = {s.N_p}, N_u = {s.N_u}. It predicts without dead time, and solves its QP exactly.",
        _listed("r", channels.y, n_y),
        _listed("u", channels.u, n_u),
        _listed("x", channels.x, n_x),
    )
    arrays = {"BASE": qp.base, "G": qp.G, "NORM": np.linalg.norm(qp.G, axis=1), "OFFSET": qp.offset}
    arrays |= {
        "SLOPES": qp.slopes,
        "LOW": qp.low,
        "HIGH": qp.high,
        "MOST_DOWN": qp.du_min,
        "MOST_UP": qp.du_max,
    }
    constants = [
        f"    const double ABSOLUTE = {_number(s.tolerances.absolute)};",
        f"    const double RELATIVE = {_number(s.tolerances.relative)};",
        *_declared(arrays),
    ]
    return Template(_MPC).substitute(
        about=head,
        guard=name.upper(),
        name=name,
        sizes=", ".join(f"{key} = {value}" for key, value in sizes.items()),
        constants="\n".join(constants),
        most=s.tolerances.max_iterations,
        p=p,
        m=m,
        n=n,
    )
