import type { State } from "../shared/state";
import type { CameraFeed } from "./feeds/feed";
import type { Camera } from "./geometry/camera";
import { arranged, type Cell, within } from "./geometry/view_arrangement";
import { aspectOf, type View, viewOf } from "./geometry/views";

const NARROW = matchMedia("(max-width: 899px), (max-height: 479px)");
const MAX_DOTS = 2; // canvas pixels per CSS pixel, maximum

/** Return the effective state: the default of `fit` depends on the size of the page. */
export const asShown = (s: State): State =>
  s.fit ? s : { ...s, fit: NARROW.matches ? "fill" : "whole" };

/** View and its rectangle on the canvas, CSS px. */
export interface Place extends Cell {
  state: State;
  view: View;
  /** Image and camera; null while loading. */
  cameraFeed: CameraFeed | null;
  /** Parts of the view at their canvas positions. */
  parts: View["parts"];
}

/** Layout: all views, and the combined view of those with the main image. */
export interface Layout {
  places: Place[];
  view: View;
}

/** Lay out views on a canvas in the available area and resize it: one with its aspect ratio, or several side by side; views without an image use the main camera. */
export function layOut(
  states: readonly State[],
  cameraFeed: readonly (CameraFeed | null)[],
  shown: Camera,
  canvas: HTMLElement,
  room: { width: number; height: number },
): Layout {
  const dots = Math.min(devicePixelRatio, MAX_DOTS);
  const pixels = (side: number): number => Math.max(2, Math.floor(side * dots));
  const through = cameraFeed.map((one) => one?.camera ?? shown);
  const aspects = states.map((s, i) => aspectOf(s, through[i]));
  const isOne = states.length === 1;
  const cells = isOne
    ? [{ ...within(aspects[0], { left: 0, top: 0, ...room }), left: 0, top: 0 }]
    : arranged(aspects, room.width, room.height);
  const places = states.map((state, i): Place => {
    const view = viewOf(state, through[i], pixels(cells[i].width), pixels(cells[i].height));
    return {
      ...cells[i],
      state,
      view,
      cameraFeed: cameraFeed[i],
      parts: moved(view, cells[i], dots),
    };
  });
  const { width, height } = isOne
    ? places[0].view
    : { width: pixels(room.width), height: pixels(room.height) };
  canvas.style.width = `${width / dots}px`;
  canvas.style.height = `${height / dots}px`;
  return {
    places,
    view: {
      width,
      height,
      parts: places.filter((p) => p.cameraFeed?.camera === shown).flatMap((p) => p.parts),
    },
  };
}

function moved(view: View, { left, top }: Cell, dots: number): View["parts"] {
  return view.parts.map((part) => ({
    ...part,
    left: part.left + Math.round(left * dots),
    top: part.top + Math.round(top * dots),
  }));
}
