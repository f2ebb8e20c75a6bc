"""Names that a stranger may give to folders: printable, without a slash."""

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
