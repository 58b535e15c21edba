import { h } from "../shared/dom";

const TERMS: [term: string, meaning: string][] = [
  ["Ω, field angle", "angle of what is seen from the direction back past the lens: 90° is the horizon of a mirror that looks along it"],
  ["Θ", "angle of the ray at the lens against its axis; Θ max is that of the rim"],
  ["T, S", "tangential (along the image radius) and sagittal (around it): a mirror focuses the two at different distances"],
  ["T∞, T5M", "virtual images of objects infinitely far away and at five rim radii M, tangential; S∞ and S5M the same, sagittal"],
  ["Rim radius, M", "half the diameter of the mirror"],
  ["Object at ∞", "what is looked at stands infinitely far away; the plots are of the distance under Objects"],
  ["Depth of field", "between these distances of virtual images the blur stays below a pixel"],
  ["Viewpoint", "height over the mirror's vertex at which the rays of a field angle seem to meet; their spread is the parallax"],
  ["Aspect", "width over height of the image of a small square"],
  ["Blur area", "product of both blurs in angle, a pixel and the Airy disk added to each"],
  ["Free form", "family of curves in which the mirror is sought; terms are how many numbers shape it"],
  ["Starts", "from how many first guesses the search is begun: more take longer, and miss the best less often"],
  ["Pin", "keeps the design as it is, drawn in another colour and kind of line, while you change the one in hand"],
];

/** What the words of the bench mean, for who asks. */
export const glossary = (): HTMLElement => h("details", { className: "glossary" }, h("summary", {}, "What the words mean"), h("dl", {}, ...TERMS.flatMap(([term, meaning]) => [h("dt", {}, term), h("dd", {}, meaning)])));
