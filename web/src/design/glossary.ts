import { h } from "../shared/dom";
import type { QuantityInfo } from "../shared/messages";
import { explained, symbolOf } from "./labels";

/** Terms of the page; quantities are explained by the server. */
const TERMS: [term: string, meaning: string][] = [
  [
    "Θ",
    "viewing angle: angle between the ray at the lens and the optical axis; Θ max is that of the rim",
  ],
  [
    "T, S",
    "tangential (along the image radius) and sagittal (perpendicular to it); the virtual images are at different distances (astigmatism)",
  ],
  [
    "T, ∞ and T, 5 M",
    "tangential virtual images of objects at infinity and at five rim radii M; S: sagittal",
  ],
  ["Rim radius, M", "half of the mirror diameter"],
  ["Object at ∞", "infinite object distance; plots are computed for the distance under Objects"],
  ["Depth of field", "distances of virtual images between which the blur is less than one pixel"],
  [
    "Freeform",
    "parametrisation of the optimised mirror profile; terms: number of its coefficients",
  ],
  ["Maximum blur", "largest tangential or sagittal blur over the field, from geometrical optics"],
  [
    "Total blur",
    "root of the sum of the squares of geometrical blur and Airy disc; therefore larger than the maximum blur",
  ],
  [
    "Number of starts",
    "number of starting points of the search; more starts take longer and find the global optimum more reliably",
  ],
  [
    "Handles on curves",
    "drag a handle or press arrow keys: the profile or the mapping of the mirror is deformed to pass through it",
  ],
  [
    "Dashed line in a plot",
    "limit of the requirements; the hatched side is not permitted; drag the line to change the limit",
  ],
  [
    "Bar under a slider",
    "range of values for which all requirements are met, with the other parameters unchanged",
  ],
  ["Pin", "stores the design for comparison, drawn in another colour and line style"],
];

/** Create the glossary of the Design tab. */
export function glossary(vocabulary: QuantityInfo[], shown: string[]): HTMLElement {
  const quantities = vocabulary
    .filter((q) => shown.includes(q.name))
    .map((q): [string, string] => [`${q.title}, ${symbolOf(q)}`, explained(q)]);
  const terms = [...quantities, ...TERMS].flatMap(([term, meaning]) => [
    h("dt", {}, term),
    h("dd", {}, meaning),
  ]);
  return h(
    "details",
    { className: "glossary" },
    h("summary", {}, "Glossary"),
    h("dl", {}, ...terms),
  );
}
