import uplotSheet from "uplot/dist/uPlot.min.css?inline";
import { Bench } from "./bench";
import sheet from "./design.css?inline";
import { fromAddress } from "./model/address";
import { stored } from "./model/storage";
import type { Host } from "./host";
import * as supply from "./data_source";
import tolerancesSheet from "./tolerances/tolerances.css?inline";

const FIRST = "paper-spherical";

/** Create the bench with the design of the address, the stored design, or the default. */
export async function begin(host: Host): Promise<Bench> {
  for (const text of [uplotSheet, sheet, tolerancesSheet]) {
    const styleSheet = new CSSStyleSheet();
    styleSheet.replaceSync(text);
    document.adoptedStyleSheets = [...document.adoptedStyleSheets, styleSheet];
  }
  const parts = await supply.benchStart();
  const before = stored(parts);
  const address_ = host.address() ? fromAddress(host.address(), parts) : null;
  const linked = typeof address_ === "string" ? null : address_;
  const design = linked ??
    before?.design ?? { ...(await supply.bundled(FIRST)), distance: null, requirements: null };
  const bench = new Bench(host, parts, design);
  if (before) {
    bench.pins = before.pins;
    bench.plotArea.switched = before.switched;
    if (JSON.stringify(before.design) === JSON.stringify(design)) bench.history.restore(before);
  }
  bench.plotArea.showGroups();
  bench.begin();
  if (typeof address_ === "string") bench.reportInvalidAddress(address_);
  bench.setErrorsFrom(host.errors());
  return bench;
}
