"""Show the page of a study in a notebook: in a frame if the notebook is on this machine."""

from jinja2 import Environment

_HTML = """
<div id="{{ name }}"><p><a href="{{ link }}" target="_blank" rel="noopener">Open the questions in a
tab of their own</a></p></div>
<script>
(() => {
  const place = document.getElementById({{ name | tojson }});
  const link = new URL({{ link | tojson }});
  const here = location.hostname;
  if (!place || location.protocol !== "http:" || !["127.0.0.1", "localhost"].includes(here)) return;
  link.hostname = here;  // the cookie of another name would not be sent
  const frame = document.createElement("iframe");
  Object.assign(frame, { src: link.href, title: "prefcal: which of two runs is better?" });
  Object.assign(frame.style, { width: "100%", height: {{ height | tojson }}, border: "0" });
  place.append(frame);
})();
</script>
"""


def framed(link: str, height: int) -> str:
    """Return HTML with a link to the page, and a frame with it where browsers allow that.

    A frame works if the notebook's own page comes from localhost or 127.0.0.1: browsers keep the
    page's cookie from frames on pages of other sites. Elsewhere the link remains.

    Args:
        link: Link of the page, with its secret.
        height: Height of the frame in pixels.
    """
    name = f"prefcal-{link.rpartition('/')[2][:12]}"
    template = Environment(autoescape=True).from_string(_HTML)
    return template.render(link=link, name=name, height=f"{height}px")
