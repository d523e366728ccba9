// What the browser tests share: the browser, dropping files, and counting what does not hold.

import { mkdirSync, readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { basename, dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

export const root = dirname(dirname(dirname(fileURLToPath(import.meta.url))));
/** Where pictures and files go. */
export const out = join(root, "target/browser");
mkdirSync(out, { recursive: true });

let failures = 0;
export function check(holds, text) {
  console.log(`${holds ? "ok  " : "FAIL"} ${text}`);
  if (!holds) failures++;
}

/** Says how it went and ends the process. */
export function finish(what) {
  console.log(failures === 0 ? `\n${what} holds` : `\n${failures} checks failed; pictures in ${out}`);
  process.exit(failures === 0 ? 0 : 1);
}

/** Chromium that draws in software and speaks to nobody by itself. */
export function launch() {
  const npm = resolve(process.env.ISOLUME_NPM || join(root, "target/npm"));
  const { chromium } = createRequire(join(npm, "package.json"))("playwright-core");
  return chromium.launch({
    executablePath: process.env.CHROMIUM || "/usr/bin/chromium",
    args: ["--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
      "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"],
  });
}

/** Drops a file onto the page's canvas, as a hand would. */
export async function dropFile(page, path) {
  await page.evaluate(([bytes, name]) => {
    const transfer = new DataTransfer();
    transfer.items.add(new File([Uint8Array.from(atob(bytes), (c) => c.charCodeAt(0))], name));
    for (const type of ["dragover", "drop"]) {
      document.getElementById("canvas").dispatchEvent(new DragEvent(type, { dataTransfer: transfer, bubbles: true, cancelable: true }));
    }
  }, [readFileSync(path).toString("base64"), basename(path)]);
}
