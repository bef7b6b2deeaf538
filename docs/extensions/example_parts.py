"""What an example consists of: what it says about itself, its code, and what it prints."""

import ast
import textwrap

PRINTS = "\n\nPrints:\n\n"


def parts(source: str) -> tuple[str, str, str]:
    """Returns what a script says about itself, its code, and what it prints."""
    first = ast.parse(source).body[0]
    docstring = textwrap.dedent(ast.get_docstring(ast.parse(source)) or "")
    code = "\n".join(source.splitlines()[first.end_lineno :]).strip() + "\n"
    text, _, output = docstring.partition(PRINTS)
    return text.strip(), code, textwrap.dedent(output).rstrip()
