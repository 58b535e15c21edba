import { background } from "../../shared/background";
import * as api from "../../shared/api";
import { h, svg } from "../../shared/dom";
import type { CalibrationResult } from "../../shared/messages";
import { arrows, crosses, timesFor } from "../drawing";
import type { Rim } from "../panels/camera";
import type { BoardImage } from "../board_images";
import { px, stateWords } from "../formatting";

const ARROW_PX = 12; // length of a typical residual in the image

interface Callbacks {
  remove: (boardImage: BoardImage) => void;
  retry: (boardImage: BoardImage) => void;
  fail: (e: unknown) => void;
}

/** Selected image: corners, rim, residuals, and the undistorted target. */
export class ImageDetail {
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
  private boardImage: BoardImage | null = null;
  private address = "";
  private shown: CalibrationResult | null = null;

  constructor(private readonly callbacks: Callbacks) {
    this.again = h(
      "button",
      {
        type: "button",
        className: "small",
        onclick: () => this.boardImage && callbacks.retry(this.boardImage),
      },
      "Detect again",
    );
    const bar = h(
      "div",
      { className: "bar" },
      this.title,
      this.again,
      h(
        "button",
        {
          type: "button",
          className: "small",
          onclick: () => this.boardImage && callbacks.remove(this.boardImage),
        },
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

  show(boardImage: BoardImage | null, rim: Rim | null, result: CalibrationResult | null): void {
    this.element.hidden = boardImage === null;
    if (!boardImage) {
      this.boardImage = null;
      return;
    }
    if (boardImage !== this.boardImage) this.load(boardImage);
    this.title.textContent = boardImage.name;
    this.again.hidden = boardImage.error === null;
    const outcome = result?.images.find((p) => p.name === boardImage.name) ?? null;
    const reason = boardImage.error ?? outcome?.reason ?? boardImage.reason;
    const state = boardImage.detection
      ? stateWords(boardImage.detection, reason)
      : (boardImage.error ?? "Detecting the target…");
    const times = outcome?.rms_px ? timesFor(outcome.rms_px, ARROW_PX) : 1;
    this.words.textContent = outcome?.used
      ? `${state}, RMS residual ${px(outcome.rms_px)}; residuals magnified ${times} times.`
      : state;
    this.draw(boardImage, rim, outcome?.used ? arrows(outcome.residuals, times) : "");
    if (boardImage !== this.boardImage || result !== this.shown)
      background(this.straighten(boardImage, result));
    this.boardImage = boardImage;
    this.shown = result;
  }

  private load(boardImage: BoardImage): void {
    URL.revokeObjectURL(this.address);
    this.image.alt = `Image ${boardImage.name}`;
    this.address = URL.createObjectURL(boardImage.blob);
    this.image.onerror = () => {
      if (boardImage === this.boardImage) this.image.src = boardImage.thumbnail; // for formats that browsers do not support
    };
    this.image.src = this.address;
  }

  private draw(boardImage: BoardImage, rim: Rim | null, residuals: string): void {
    const [width, height] = boardImage.detection?.image_size ?? [0, 0];
    this.overlay.setAttribute("viewBox", `-0.5 -0.5 ${width || 1} ${height || 1}`);
    const { detection } = boardImage;
    const isUsed = detection !== null && boardImage.reason === null;
    this.overlay.replaceChildren(
      ...(detection && rim
        ? [svg("circle", { class: "rim", cx: rim.centre[0], cy: rim.centre[1], r: rim.radius })]
        : []),
      ...(detection
        ? [
            svg("path", {
              class: isUsed ? "corners" : "corners unused",
              d: crosses(detection.corners_px, Math.max(width, height) / 150),
            }),
          ]
        : []),
      ...(residuals ? [svg("path", { class: "residuals", d: residuals })] : []),
    );
  }

  /** Display the target undistorted with the calibrated camera. */
  private async straighten(
    boardImage: BoardImage,
    result: CalibrationResult | null,
  ): Promise<void> {
    const pose = result?.poses.find((p) => p.image === boardImage.name);
    this.straightFigure.hidden = !pose;
    this.straight.hidden = true;
    if (!result || !pose) return;
    const off = result.images.find((p) => p.name === boardImage.name)?.line_deviation_px ?? null;
    this.straightWords.textContent = "Undistorting the target…";
    try {
      const undistorted = await api.straight(
        { camera_file: result.camera_file, pose, name: boardImage.name },
        boardImage.blob,
      );
      if (boardImage !== this.boardImage || result !== this.shown) return;
      URL.revokeObjectURL(this.straight.src);
      this.straight.src = URL.createObjectURL(undistorted);
      this.straight.hidden = false;
      this.straightWords.textContent = `Undistorted target: maximum deviation of corners from straight lines ${px(off, 2)}.`;
    } catch (e) {
      if (e instanceof api.RequestRejected) this.straightWords.textContent = e.message;
      else this.callbacks.fail(e);
    }
  }
}
