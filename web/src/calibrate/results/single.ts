import { background } from "../../shared/background";
import * as api from "../../shared/api";
import { h, svg } from "../../shared/dom";
import type { CalibrationResult } from "../../shared/messages";
import { arrows, crosses, timesFor } from "../drawing";
import type { Rim } from "../panels/camera";
import type { Shot } from "../shots";
import { px, stateWords } from "../words";

const ARROW_PX = 12; // length of a typical residual in the image

interface Hands {
  remove: (shot: Shot) => void;
  retry: (shot: Shot) => void;
  fail: (e: unknown) => void;
}

/** Selected image: corners, rim, residuals, and the undistorted target. */
export class Single {
  readonly element = h("section", {
    className: "plot single",
    "aria-label": "Selected image",
    hidden: true,
  });
  private readonly title = h("b", {});
  private readonly words = h("p", { className: "words" });
  private readonly image = h("img", {});
  private readonly overlay = svg("svg", { "aria-hidden": "true" });
  private readonly straight = h("img", { alt: "Undistorted target" });
  private readonly straightFigure: HTMLElement;
  private readonly straightWords = h("figcaption", {});
  private readonly again: HTMLElement;
  private shot: Shot | null = null;
  private address = "";
  private shown: CalibrationResult | null = null;

  constructor(private readonly hands: Hands) {
    this.again = h(
      "button",
      { type: "button", className: "small", onclick: () => this.shot && hands.retry(this.shot) },
      "Detect again",
    );
    const bar = h(
      "div",
      { className: "bar" },
      this.title,
      this.again,
      h(
        "button",
        { type: "button", className: "small", onclick: () => this.shot && hands.remove(this.shot) },
        "Remove image",
      ),
    );
    this.straightFigure = h("figure", { hidden: true }, this.straight, this.straightWords);
    const raw = h(
      "figure",
      {},
      h("div", { className: "whole" }, this.image, this.overlay),
      this.words,
    );
    this.element.append(bar, h("div", { className: "pair" }, raw, this.straightFigure));
  }

  show(shot: Shot | null, rim: Rim | null, found: CalibrationResult | null): void {
    this.element.hidden = shot === null;
    if (!shot) {
      this.shot = null;
      return;
    }
    if (shot !== this.shot) this.load(shot);
    this.title.textContent = shot.name;
    this.again.hidden = shot.trouble === null;
    const outcome = found?.pictures.find((p) => p.name === shot.name) ?? null;
    const reason = shot.trouble ?? outcome?.reason ?? shot.reason;
    const state = shot.seen
      ? stateWords(shot.seen, reason)
      : (shot.trouble ?? "Detecting the target…");
    const times = outcome?.rms_px ? timesFor(outcome.rms_px, ARROW_PX) : 1;
    this.words.textContent = outcome?.used
      ? `${state}, RMS residual ${px(outcome.rms_px)}; residuals magnified ${times} times.`
      : state;
    this.draw(shot, rim, outcome?.used ? arrows(outcome.residuals, times) : "");
    if (shot !== this.shot || found !== this.shown) background(this.straighten(shot, found));
    this.shot = shot;
    this.shown = found;
  }

  private load(shot: Shot): void {
    URL.revokeObjectURL(this.address);
    this.image.alt = `Image ${shot.name}`;
    this.address = URL.createObjectURL(shot.blob);
    this.image.onerror = () => {
      if (shot === this.shot) this.image.src = shot.thumbnail; // for formats that browsers do not support
    };
    this.image.src = this.address;
  }

  private draw(shot: Shot, rim: Rim | null, residuals: string): void {
    const [width, height] = shot.seen?.image_size ?? [0, 0];
    this.overlay.setAttribute("viewBox", `-0.5 -0.5 ${width || 1} ${height || 1}`);
    const { seen } = shot;
    const isUsed = seen !== null && shot.reason === null;
    this.overlay.replaceChildren(
      ...(seen && rim
        ? [svg("circle", { class: "rim", cx: rim.centre[0], cy: rim.centre[1], r: rim.radius })]
        : []),
      ...(seen
        ? [
            svg("path", {
              class: isUsed ? "corners" : "corners unused",
              d: crosses(seen.corners_px, Math.max(width, height) / 150),
            }),
          ]
        : []),
      ...(residuals ? [svg("path", { class: "residuals", d: residuals })] : []),
    );
  }

  /** Display the target undistorted with the calibrated camera. */
  private async straighten(shot: Shot, found: CalibrationResult | null): Promise<void> {
    const place = found?.places.find((p) => p.picture === shot.name);
    this.straightFigure.hidden = !place;
    this.straight.hidden = true;
    if (!found || !place) return;
    const off = found.pictures.find((p) => p.name === shot.name)?.line_deviation_px ?? null;
    this.straightWords.textContent = "Undistorting the target…";
    try {
      const made = await api.straight(
        { camera_file: found.camera_file, place, name: shot.name },
        shot.blob,
      );
      if (shot !== this.shot || found !== this.shown) return;
      URL.revokeObjectURL(this.straight.src);
      this.straight.src = URL.createObjectURL(made);
      this.straight.hidden = false;
      this.straightWords.textContent = `Undistorted target: maximum deviation of corners from straight lines ${px(off, 2)}.`;
    } catch (e) {
      if (e instanceof api.Refused) this.straightWords.textContent = e.message;
      else this.hands.fail(e);
    }
  }
}
