import * as api from "../shared/api";
import { Calibrate } from "./calibrate";
import sheet from "./calibrate.css?inline";
import type { Host } from "./host";

/** Create the tab with the stored images. */
export async function begin(host: Host): Promise<Calibrate> {
  const styleSheet = new CSSStyleSheet();
  styleSheet.replaceSync(sheet);
  document.adoptedStyleSheets = [...document.adoptedStyleSheets, styleSheet];
  const calibrate = new Calibrate(host, await api.calibrateStart());
  await calibrate.begin();
  return calibrate;
}
