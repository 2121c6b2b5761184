"""Ticks of a logarithmic axis say their whole number."""

DRAWN = """async ([low, high]) => {
    const { tried } = await import("/static/miniature.js");
    const div = document.body.appendChild(document.createElement("div"));
    div.style.width = "400px";
    tried(div, { name: "K_p", unit: "", scale: "log10", low, high }, 0, []);
    return [...div.querySelectorAll(".ytick text")].map((tick) => tick.textContent);
}"""


def test_the_ticks_of_less_than_two_decades_keep_their_power_of_ten(opened):
    _, watched = opened()
    assert watched.page.evaluate(DRAWN, [0.32, 8.1]) == ["0.5", "1", "2", "5"]
    assert watched.page.evaluate(DRAWN, [1.8, 45]) == ["2", "5", "10", "20", "50"]
    assert watched.page.evaluate(DRAWN, [0.01, 100]) == ["0.01", "0.1", "1", "10", "100"]
