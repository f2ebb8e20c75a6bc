"""Hostile names of folders (printable, without a slash), and hostile texts of files and servers."""

HOSTILE = (
    "<script>alert(1)</script>".replace("/", "\u2044"),
    '" onmouseover=alert(1) x="',
    "' style='position:fixed",
    "a%2e%2e#b?c=d&amp;e",
    '") url(javascript:alert(1)',
    "\\22 );color:red;x:url(",
    "{{ 7 * 7 }} {% raw %}",
    "*",
    "[a-z]",
    "two  spaces, öäü, \u4e2d\u6587",
    "x" * 90,
)

RUNS = "top.ran = true"
HOSTILE_WORDS = (
    f'<iframe srcdoc="<script>{RUNS}</script>"></iframe>',
    f'<img src="x" onerror="{RUNS}">',
    f"{{(() => {{ {RUNS} }})()}}",
    f"export const x = {RUNS}",
    f'import "data:text/javascript,{RUNS}"',
    f"[click](javascript:{RUNS})",
    "![picture](/etc/hostname)",
    "<style>body { display: none }</style>",
    "# heading",
    "**bold** _thin_ `code` $x$ a|b ~~gone~~ <b>bold</b> &amp; &#60;",
)

CONTROLS = "\u202e\u2066\u200f\x1b\x85"
"""Bidirectional and control characters, which reorder or hide the text around them."""
OUT_OF_ALL = f"-->]]>'\"></script></title></style></svg><script>{RUNS}</script><img src=x onerror={RUNS}>"
"""Text that leaves every place of a page in which text can stand, and then runs a script."""
