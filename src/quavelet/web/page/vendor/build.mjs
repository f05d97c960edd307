// Makes three.min.js, uplot.min.js, uplot.css, the licences and SHA256SUMS from the packages that package-lock.json
// names by their hashes: npm ci && npm run build
import { createHash } from "node:crypto";
import { copyFileSync, readFileSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

const from = (path) => new URL(`node_modules/${path}`, import.meta.url);
const to = (name) => new URL(name, import.meta.url);

await build({
  absWorkingDir: import.meta.dirname,
  entryPoints: ["three_used.js"],
  outfile: "three.min.js",
  bundle: true,
  format: "esm",
  legalComments: "eof",
  minify: true,
  target: "es2022",
});
await build({
  absWorkingDir: import.meta.dirname,
  entryPoints: ["node_modules/uplot/dist/uPlot.esm.js"],
  outfile: "uplot.min.js",
  format: "esm",
  legalComments: "eof",
  minify: true,
  target: "es2022",
});
copyFileSync(from("uplot/dist/uPlot.min.css"), to("uplot.css"));
copyFileSync(from("three/LICENSE"), to("three.LICENSE.txt"));
copyFileSync(from("uplot/LICENSE"), to("uplot.LICENSE.txt"));

const names = ["three.LICENSE.txt", "three.min.js", "uplot.LICENSE.txt", "uplot.css", "uplot.min.js"];
const hash = (name) => createHash("sha256").update(readFileSync(to(name))).digest("hex");
writeFileSync(to("SHA256SUMS"), names.map((name) => `${hash(name)}  ${name}\n`).join(""));
