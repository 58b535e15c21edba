import type { State } from "../shared/state";
import type { Camera } from "./geometry/camera";
import { arranged, type Cell, within } from "./geometry/arrangement";
import { aspectOf, type View, viewOf } from "./geometry/views";

const NARROW = matchMedia("(max-width: 899px), (max-height: 479px)");
const MOST_DOTS = 2; // of the canvas, for a pixel of the page

/** The state as this page shows it: whether a view fills the stage, where nobody chose, is a matter of room. */
export const asShown = (s: State): State => (s.fit ? s : { ...s, fit: NARROW.matches ? "fill" : "whole" });

/** A view and its place on the canvas, px of the page. */
export interface Place extends Cell {
  state: State;
  view: View;
}

/** All that is drawn: the views, and the canvas that holds them. */
export interface Laid {
  places: Place[];
  view: View;
}

/** Lay views out on a canvas no larger than the room there is, and make it so large: one as it wants to be, or several side by side. */
export function lay(states: readonly State[], camera: Camera, canvas: HTMLCanvasElement, room: { width: number; height: number }): Laid {
  const dots = Math.min(devicePixelRatio, MOST_DOTS);
  const pixels = (side: number): number => Math.max(2, Math.floor(side * dots));
  const aspects = states.map((s) => aspectOf(s, camera));
  const isOne = states.length === 1;
  const cells = isOne ? [{ ...within(aspects[0], { left: 0, top: 0, ...room }), left: 0, top: 0 }] : arranged(aspects, room.width, room.height);
  const places = states.map((state, i): Place => {
    const view = viewOf(state, camera, pixels(cells[i].width), pixels(cells[i].height));
    return { ...cells[i], state, view };
  });
  const [{ view }] = places;
  const whole: View = isOne ? view : { width: pixels(room.width), height: pixels(room.height), parts: places.flatMap((p) => moved(p, dots)) };
  canvas.style.width = `${whole.width / dots}px`;
  canvas.style.height = `${whole.height / dots}px`;
  return { places, view: whole };
}

function moved({ view, left, top }: Place, dots: number): View["parts"] {
  return view.parts.map((part) => ({ ...part, left: part.left + Math.round(left * dots), top: part.top + Math.round(top * dots) }));
}
