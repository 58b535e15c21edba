import { h } from "../../shared/dom";
import type { CalibrationResult } from "../../shared/messages";
import { words } from "../../shared/numbers";
import { modelWords, px } from "../formatting";
import { radiusPlot, residualPlot } from "./plots";

const MAX_OUTLIERS = 40;

/** Create the summary of a calibration: values and residuals. */
export function resultsOf(result: CalibrationResult): HTMLElement[] {
  const used = result.images.filter((p) => p.used).length;
  const numbers: [string, string][] = [
    ["Model", modelWords(result.kind)],
    ["RMS", px(result.rms_px)],
    ["RMS, held out", px(result.held_out_rms_px)],
    ["Images", `${used} of ${result.images.length}`],
    ["Corners used", `${result.corners - result.outliers.length} of ${result.corners}`],
    ["Duration", `${words(result.seconds, 2)} s`],
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
      list("notes", result.notes),
    ),
    h("div", { className: "plots" }, residualPlot(result), radiusPlot(result)),
  ];
}

/** Create the tables of images, parameters, models and outliers. */
export const tablesOf = (
  result: CalibrationResult,
  choose: (image: string) => void,
): HTMLElement[] => [
  images(result, choose),
  parameters(result),
  ...(result.models.length > 1 ? [models(result)] : []),
  outliers(result),
];

/** Create a list of messages. */
export const list = (className: string, sentences: readonly string[]): HTMLElement =>
  h("ul", { className, hidden: !sentences.length }, ...sentences.map((s) => h("li", {}, s)));

function images(result: CalibrationResult, choose: (image: string) => void): HTMLElement {
  const name = (image: string): HTMLElement =>
    h("button", { type: "button", className: "link", onclick: () => choose(image) }, image);
  const rows = result.images.map((p) => [
    name(p.name),
    String(p.corners),
    p.rms_px === null ? "–" : words(p.rms_px, 3),
    p.held_out_rms_px === null ? "–" : words(p.held_out_rms_px, 3),
    p.used ? "used" : (p.reason ?? "not used"),
  ]);
  return table("Images", ["image", "corners", "RMS, px", "held out, px", ""], rows);
}

function parameters(result: CalibrationResult): HTMLElement {
  const rows = result.parameters.map((p) => [
    p.name.replaceAll("_", " "),
    words(p.value, 6),
    p.sigma === null ? "fixed" : `± ${words(p.sigma, 2)}`,
    p.unit,
  ]);
  return table("Parameters with standard deviations", ["", "value", "sigma", "unit"], rows);
}

function models(result: CalibrationResult): HTMLElement {
  const rows = result.models.map((m) => [
    m.kind === result.kind ? h("b", {}, modelWords(m.kind)) : modelWords(m.kind),
    String(m.parameters),
    words(m.rms_px, 3),
    m.held_out_rms_px === null ? "–" : words(m.held_out_rms_px, 3),
    m.reason,
  ]);
  return table("Compared models", ["model", "parameters", "RMS, px", "held out, px", ""], rows);
}

function outliers(result: CalibrationResult): HTMLElement {
  const shown = result.outliers.slice(0, MAX_OUTLIERS);
  if (!shown.length) return h("p", { className: "words" }, "There are no outliers.");
  const element = table(
    "Outliers",
    ["image", "corner", "residual, px"],
    shown.map((o) => [o.image, String(o.corner), words(o.residual_px, 3)]),
  );
  if (shown.length < result.outliers.length)
    element.append(
      h(
        "p",
        { className: "words" },
        `and ${result.outliers.length - shown.length} more, listed in the report.`,
      ),
    );
  return element;
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
