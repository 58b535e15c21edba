import { h } from "../../shared/dom";
import type { CalibrationResult } from "../../shared/messages";
import { words } from "../../shared/numbers";
import { modelWords, px } from "../words";
import { radiusPlot, residualPlot } from "./plots";

const MAX_OUTLIERS = 40;

/** Create the summary of a calibration: values and residuals. */
export function resultsOf(found: CalibrationResult): HTMLElement[] {
  const used = found.pictures.filter((p) => p.used).length;
  const numbers: [string, string][] = [
    ["Model", modelWords(found.kind)],
    ["RMS", px(found.rms_px)],
    ["RMS, held out", px(found.held_out_rms_px)],
    ["Images", `${used} of ${found.pictures.length}`],
    ["Corners used", `${found.corners - found.outliers.length} of ${found.corners}`],
    ["Duration", `${words(found.seconds, 2)} s`],
  ];
  return [
    h(
      "section",
      { className: "headline", "aria-label": "Result" },
      h(
        "dl",
        {},
        ...numbers.map(([term, value]) => h("div", {}, h("dt", {}, term), h("dd", {}, value))),
      ),
      list("notes", found.notes),
    ),
    h("div", { className: "plots" }, residualPlot(found), radiusPlot(found)),
  ];
}

/** Create the tables of images, parameters, models and outliers. */
export const tablesOf = (
  found: CalibrationResult,
  choose: (picture: string) => void,
): HTMLElement[] => [
  pictures(found, choose),
  parameters(found),
  ...(found.models.length > 1 ? [models(found)] : []),
  outliers(found),
];

/** Create a list of messages. */
export const list = (className: string, sentences: readonly string[]): HTMLElement =>
  h("ul", { className, hidden: !sentences.length }, ...sentences.map((s) => h("li", {}, s)));

function pictures(found: CalibrationResult, choose: (picture: string) => void): HTMLElement {
  const name = (picture: string): HTMLElement =>
    h("button", { type: "button", className: "link", onclick: () => choose(picture) }, picture);
  const rows = found.pictures.map((p) => [
    name(p.name),
    String(p.found),
    p.rms_px === null ? "–" : words(p.rms_px, 3),
    p.held_out_rms_px === null ? "–" : words(p.held_out_rms_px, 3),
    p.used ? "used" : (p.reason ?? "not used"),
  ]);
  return table("Images", ["image", "corners", "RMS, px", "held out, px", ""], rows);
}

function parameters(found: CalibrationResult): HTMLElement {
  const rows = found.parameters.map((p) => [
    p.name.replaceAll("_", " "),
    words(p.value, 6),
    p.sigma === null ? "fixed" : `± ${words(p.sigma, 2)}`,
    p.unit,
  ]);
  return table("Parameters with standard deviations", ["", "value", "sigma", "unit"], rows);
}

function models(found: CalibrationResult): HTMLElement {
  const rows = found.models.map((m) => [
    m.kind === found.kind ? h("b", {}, modelWords(m.kind)) : modelWords(m.kind),
    String(m.parameters),
    words(m.rms_px, 3),
    m.held_out_rms_px === null ? "–" : words(m.held_out_rms_px, 3),
    m.why,
  ]);
  return table("Compared models", ["model", "parameters", "RMS, px", "held out, px", ""], rows);
}

function outliers(found: CalibrationResult): HTMLElement {
  const shown = found.outliers.slice(0, MAX_OUTLIERS);
  if (!shown.length) return h("p", { className: "words" }, "There are no outliers.");
  const made = table(
    "Outliers",
    ["picture", "corner", "residual, px"],
    shown.map((o) => [o.picture, String(o.corner), words(o.residual_px, 3)]),
  );
  if (shown.length < found.outliers.length)
    made.append(
      h(
        "p",
        { className: "words" },
        `and ${found.outliers.length - shown.length} more, listed in the report.`,
      ),
    );
  return made;
}

function table(
  title: string,
  heads: readonly string[],
  rows: readonly (string | HTMLElement)[][],
): HTMLElement {
  const cell = (value: string | HTMLElement, i: number): HTMLElement =>
    i ? h("td", { className: heads[i] ? "" : "why" }, value) : h("th", { scope: "row" }, value);
  const head = h(
    "tr",
    {},
    ...heads.map((text) => (text ? h("th", { scope: "col" }, text) : h("td", {}))),
  );
  return h(
    "div",
    { className: "table", tabIndex: 0, role: "region", "aria-label": title },
    h(
      "table",
      {},
      h("caption", {}, title),
      h("thead", {}, head),
      h("tbody", {}, ...rows.map((row) => h("tr", {}, ...row.map(cell)))),
    ),
  );
}
