"""Reports: results.json first, then report.html, one page that needs nothing but a browser.

Every command that judges or measures ends with the same call::

    from whitted_validation import report

    report.write(folder, results, "whitted stress", [
        report.Sentence("All 31 cases hold.", "good"),
        report.Table(["case", "error"], [["gap", 3.1e-8], ["far ball", report.Cell("none", "bad")]]),
        report.Group("Gap", [report.Chart("Error against epsilon", "epsilon", "error", {"ours": [(1e-6, 3e-8)]})]),
    ])

Sections (`sections`, `charts`, `viewer`), each a frozen dataclass described where it stands:

    Sentence(text, tone)                     a paragraph; the first one is the verdict and is set large
    Table(columns, rows, caption)            cells are str, int, float or Cell(value, tone, to); put the worst first
    Chart(title, x_label, y_label, series)   lines, log-log unless told otherwise
    Bars(title, x_label, y_label, labels, series)   stacked bars
    Picture(pixels, caption)                 linear radiance or bytes, as a PNG
    Viewer(a, b, names, ...)                 a pair of pictures to be looked into, pixel by pixel
    Markup(html)                             HTML or SVG of one's own, all names in it escaped; no style attributes
    Group(title, sections, note)             a heading with what belongs to it; `Cell(..., to=title)` leads there

tone is "", "good", "bad" or "quiet". Every text is escaped by the section that shows it. Scripts and styles
other than the page's own do not run (Content-Security-Policy); `write(..., style=css)` adds rules. Colours for
them: the custom properties --ink --quiet --line --paper --panel --accent --good --bad, which know light and dark.

results.json, schema 2. All commands: schema, command (the arguments), environment (versions, platform), and
then what the command itself documents. What is no finite number is written as "NaN", "Infinity", "-Infinity", which
both Python's float() and JavaScript's Number() read. Both files are written beside and then renamed.
"""

from whitted_validation.report.charts import Bars, Chart
from whitted_validation.report.page import write
from whitted_validation.report.sections import Cell, Group, Markup, Picture, Section, Sentence, Table
from whitted_validation.report.viewer import Viewer

__all__ = [
    "Bars",
    "Cell",
    "Chart",
    "Group",
    "Markup",
    "Picture",
    "Section",
    "Sentence",
    "Table",
    "Viewer",
    "write",
]
