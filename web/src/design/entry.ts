import uplotSheet from "uplot/dist/uPlot.min.css?inline";
import { DesignTab } from "./design_tab";
import sheet from "./design.css?inline";
import { fromAddress } from "./model/address";
import { stored } from "./model/storage";
import type { Host } from "./host";
import * as supply from "./data_source";
import tolerancesSheet from "./tolerances/tolerances.css?inline";

const FIRST = "paper-spherical";

/** Create the Design tab with the design of the address, the stored design, or the default. */
export async function begin(host: Host): Promise<DesignTab> {
  for (const text of [uplotSheet, sheet, tolerancesSheet]) {
    const styleSheet = new CSSStyleSheet();
    styleSheet.replaceSync(text);
    document.adoptedStyleSheets = [...document.adoptedStyleSheets, styleSheet];
  }
  const parts = await supply.designStart();
  const before = stored(parts);
  const address_ = host.address() ? fromAddress(host.address(), parts) : null;
  const linked = typeof address_ === "string" ? null : address_;
  const design = linked ??
    before?.design ?? { ...(await supply.bundled(FIRST)), distance: null, requirements: null };
  const tab = new DesignTab(host, parts, design);
  if (before) {
    tab.pins = before.pins;
    tab.plotArea.switched = before.switched;
    if (JSON.stringify(before.design) === JSON.stringify(design)) tab.history.restore(before);
  }
  tab.plotArea.showGroups();
  tab.begin();
  if (typeof address_ === "string") tab.reportInvalidAddress(address_);
  tab.setErrorsFrom(host.errors());
  return tab;
}
