"""Counts what the documentation of the library shows, and refuses more than is agreed.

usage: surface.py DOC [MOST]

DOC is the folder that `cargo doc --no-deps` made, such as target/doc/isolume. Counted are the items of its list and the
methods of their own of each type or trait; what is hidden is not in it, and methods of traits of others are not counted.
"""

import pathlib, re, sys

doc, most = pathlib.Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 350
listed = re.findall(r'<li><a href="([^"]+)">', (doc / "all.html").read_text())
rows = []
for link in listed:
    page = (doc / link).read_text()
    # Traits of the standard library and of others come after.
    own = re.split(r'id="(?:trait-implementations|synthetic-implementations|blanket-implementations|foreign-impls)"', page)[0]
    methods = set(re.findall(r'id="((?:ty)?method\.\w+|associatedconstant\.\w+)"', own))
    rows.append((len(methods), link))
total = len(listed) + sum(n for n, _ in rows)
print(f"{total} public items: {len(listed)} listed, {total - len(listed)} methods; at most {most}")
if "-v" in sys.argv:
    for n, link in sorted(rows, reverse=True):
        print(f"{n:5} {link}")
if total > most:
    for n, link in sorted(rows, reverse=True)[:10]:
        print(f"{n:5} {link}")
    sys.exit("more is public than agreed: hide it (#[doc(hidden)]), make it pub(crate), or say why in the commit and raise the number")
