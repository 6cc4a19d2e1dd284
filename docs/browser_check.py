"""Opens every page of the built site in headless Chromium, as a phone and a desktop show it.

Fails on what a reader would stumble over: pictures that do not load, links that lead nowhere,
formulas left as TeX, files asked from the net, and pages wider than a phone. Some pages are
photographed at both widths, to be looked at.

    python docs/browser_check.py [--site out/docs] [--output out/browser]
"""

import argparse
import shutil
import sys
from pathlib import Path
from urllib.parse import unquote, urldefrag, urlparse

from playwright.sync_api import sync_playwright

SIZES = {"phone": (390, 844), "desktop": (1280, 900)}
PHOTOGRAPHED = {
    "landing": "index.html",
    "tutorial": "tutorials/own_part.html",
    "guide": "guide/contact.html",
    "theory": "theory/contact.html",
    "gallery": "gallery/index.html",
    "example": "gallery/plate.html",
    "reference": "api/contact.html",
    "class": "api/generated/contact.ContactProblem.html",
    "performance": "performance.html",
}
LOOK = """async () => {
    if (window.MathJax?.startup?.promise) await MathJax.startup.promise;
    const all = (query) => [...document.querySelectorAll(query)];
    const rendered = (formula) => formula.querySelector("mjx-container:not(:has(mjx-merror))");
    return {
        width: document.documentElement.scrollWidth,
        ids: all("[id]").map((e) => e.id),
        links: all("a[href]").map((a) => a.href),
        images: all("img").filter((i) => !i.complete || !i.naturalWidth).map((i) => i.src),
        formulas: all(".math").filter((f) => !rendered(f)).map((f) => f.textContent.trim()),
    };
}"""


def look(site: Path, context, output: Path, size: str) -> tuple[dict[Path, dict], list[str]]:
    """Visit the pages in one width; return what each holds, and what is wrong with it."""
    seen, wrong, asked = {}, [], []
    page = context.new_page()
    page.on("request", lambda r: None if r.url.startswith(("file:", "data:")) else asked.append(r))
    for path in sorted(site.rglob("*.html")):
        name = path.relative_to(site).as_posix()
        if name.startswith("_"):  # source code, static files
            continue
        page.goto(path.as_uri())
        found = seen[path] = page.evaluate(LOOK)
        wrong += [f"{name}: picture {source} does not load" for source in found["images"]]
        wrong += [f"{name}: formula {formula} is not rendered" for formula in found["formulas"]]
        wrong += [f"{name}: asks the net for {request.url}" for request in asked]
        if found["width"] > SIZES[size][0]:
            wrong.append(f"{name}: {found['width']} wide on a {size} of {SIZES[size][0]}")
        asked.clear()
        for title in (t for t, photographed in PHOTOGRAPHED.items() if photographed == name):
            page.screenshot(path=output / f"{title}_{size}.png", full_page=True)
    return seen, wrong


def dead_links(site: Path, seen: dict[Path, dict]) -> list[str]:
    """Return the links inside the site whose file or place in it does not exist."""
    wrong = []
    for path, found in seen.items():
        for link in sorted(set(found["links"])):
            address, place = urldefrag(link)
            if not address.startswith("file:"):
                continue
            target = Path(unquote(urlparse(address).path))
            known = target not in seen or not place or unquote(place) in seen[target]["ids"]
            if not (target.is_file() and known):
                wrong.append(f"{path.relative_to(site)}: link to {link} leads nowhere")
    return wrong


def main() -> int:
    """Return the exit status: 0 where nothing is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--site", type=Path, default=Path("out/docs"))
    parser.add_argument("--output", type=Path, default=Path("out/browser"))
    options = parser.parse_args()
    site = options.site.resolve()
    options.output.mkdir(parents=True, exist_ok=True)
    wrong = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"))
        for size, (width, height) in SIZES.items():
            context = browser.new_context(viewport={"width": width, "height": height})
            seen, found = look(site, context, options.output, size)
            wrong += found
        browser.close()
    wrong += [f"{name}: no such page" for name in PHOTOGRAPHED.values() if site / name not in seen]
    wrong += dead_links(site, seen)
    print(*wrong, f"{len(seen)} pages, {len(wrong)} faults; pictures in {options.output}", sep="\n")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
