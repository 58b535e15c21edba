import { h } from "../shared/dom";
import type { QuantityOf } from "../shared/messages";
import { explained, symbolOf } from "./labels";

/** The page's own words; those of quantities come from the vocabulary. */
const TERMS: [term: string, meaning: string][] = [
  ["Θ", "angle of the ray at the lens against its axis; Θ max is that of the rim"],
  [
    "T, S",
    "tangential (along the image radius) and sagittal (around it): a mirror focuses the two at different distances",
  ],
  [
    "T∞, T5M",
    "virtual images of objects infinitely far away and at five rim radii M, tangential; S∞ and S5M the same, sagittal",
  ],
  ["Rim radius, M", "half the diameter of the mirror"],
  [
    "Object at ∞",
    "what is looked at stands infinitely far away; the plots are of the distance under Objects",
  ],
  ["Depth of field", "between these distances of virtual images the blur stays below a pixel"],
  [
    "Free form",
    "family of curves in which the mirror is sought; terms are how many numbers shape it",
  ],
  [
    "Starts",
    "from how many first guesses the search is begun: more take longer, and miss the best less often",
  ],
  [
    "Rings on curves",
    "drag one, or move it by the arrow keys: the mirror bends so that its profile, or its mapping, goes through it",
  ],
  [
    "Dashed line in a plot",
    "a limit of the requirements, on the side that is hatched; drag it to change the limit",
  ],
  ["Bar under a slider", "where on the slider all requirements are met, everything else as it is"],
  [
    "Pin",
    "keeps the design as it is, drawn in another colour and kind of line, while you change the one in hand",
  ],
];

/** What the words of the bench mean, for who asks. */
export function glossary(vocabulary: QuantityOf[], shown: string[]): HTMLElement {
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
    h("summary", {}, "What the words mean"),
    h("dl", {}, ...terms),
  );
}
