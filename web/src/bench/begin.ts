import uplotSheet from "uplot/dist/uPlot.min.css?inline";
import { Bench } from "./bench";
import sheet from "./bench.css?inline";
import { fromAddress } from "./designs/address";
import { kept } from "./designs/kept";
import type { Host } from "./host";
import * as supply from "./supply";
import tolerancesSheet from "./tolerances/tolerances.css?inline";

const FIRST = "paper-spherical";

/** Create the bench with the design of the address, the stored design, or the default. */
export async function begin(host: Host): Promise<Bench> {
  for (const text of [uplotSheet, sheet, tolerancesSheet]) {
    const made = new CSSStyleSheet();
    made.replaceSync(text);
    document.adoptedStyleSheets = [...document.adoptedStyleSheets, made];
  }
  const parts = await supply.benchStart();
  const before = kept(parts);
  const asked = host.address() ? fromAddress(host.address(), parts) : null;
  const given = typeof asked === "string" ? null : asked;
  const design = given ??
    before?.design ?? { ...(await supply.bundled(FIRST)), distance: null, requirements: null };
  const bench = new Bench(host, parts, design);
  if (before) {
    bench.pins = before.pins;
    bench.desk.switched = before.switched;
    if (JSON.stringify(before.design) === JSON.stringify(design)) bench.history.restore(before);
  }
  bench.desk.showGroups();
  bench.begin();
  if (typeof asked === "string") bench.misled(asked);
  bench.tryErrors(host.errors());
  return bench;
}
