import { byId } from "../../shared/dom";
import type { State } from "../../shared/state";
import type { Store } from "../../shared/store";
import { asShown } from "../stage";

interface Scale {
  key: "pan" | "tilt" | "hfov" | "zoom" | "height" | "distance";
  to: (x: number) => number;
  from: (value: number) => number;
  words: (value: number) => string;
}

const same = (x: number): number => x;
const degrees = (x: number): string => `${x.toFixed(1)}°`;
const millimetres = (mm: number): string =>
  mm >= 9995 ? `${(mm / 1000).toFixed(1)} m` : `${Math.round(mm)} mm`;

/** Return a logarithmic slider scale. */
function factors(low: number, high: number): Pick<Scale, "to" | "from"> {
  const range = Math.log(high / low);
  return {
    to: (x) => +(low * Math.exp(x * range)).toPrecision(3),
    from: (value) => Math.log(value / low) / range,
  };
}

const near = factors(150, 50_000);

const SCALES: Scale[] = [
  { key: "pan", to: same, from: same, words: degrees },
  { key: "tilt", to: same, from: same, words: degrees },
  { key: "hfov", to: same, from: same, words: degrees },
  { key: "zoom", ...factors(1, 20), words: (x) => `${x.toFixed(2)}×` },
  { key: "height", ...factors(100, 20_000), words: millimetres },
  {
    key: "distance",
    to: (x) => (x >= 1 ? Infinity : near.to(x)),
    from: (value) => (value === Infinity ? 1 : Math.min(0.99, near.from(value))),
    words: (x) => (x === Infinity ? "far" : millimetres(x)),
  },
];

/** Bind the sliders to the state. */
export function bindSliders(store: Store): void {
  const show = (s: State): void => {
    for (const { key, from, words } of SCALES) {
      const input = byId<HTMLInputElement>(key);
      if (document.activeElement !== input || Number(input.value) !== from(s[key]))
        input.value = String(from(s[key]));
      const text = words(s[key]);
      input.setAttribute("aria-valuetext", text);
      byId("sliders").querySelector(`output[for="${key}"]`)!.textContent = text;
    }
    for (const label of byId("sliders").querySelectorAll<HTMLElement>("label"))
      label.hidden =
        !label.dataset.for!.split(" ").includes(s.mode) ||
        (label.contains(byId("tilt")) &&
          s.mode === "panorama" &&
          s.zoom === 1 &&
          asShown(s).fit === "whole");
  };
  for (const { key, to } of SCALES) {
    const input = byId<HTMLInputElement>(key);
    input.addEventListener("input", () => store.set({ [key]: to(Number(input.value)) }));
  }
  store.listen(show);
  show(store.state);
}
