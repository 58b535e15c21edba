import { h, labelled } from "../../shared/dom";
import type { CalibrationOptions, CalibrationRequest } from "../../shared/messages";
import { words } from "../../shared/numbers";
import { modelsFor, modelWords } from "../formatting";

type Sought = Pick<
  CalibrationRequest,
  | "model"
  | "optics"
  | "camera_looks"
  | "image_flipped"
  | "centre_px"
  | "rim_radius_px"
  | "flat_board"
>;

/** Rim detected in the images. */
export type Rim = { centre: [number, number]; radius: number };

const OPTICS: [Sought["optics"], string][] = [
  ["mirror", "Mirror"],
  ["fisheye", "Fisheye"],
];
const CAMERA_ORIENTATIONS: [Sought["camera_looks"], string][] = [
  ["up", "up"],
  ["down", "down"],
  ["forward", "forward"],
];

/** Prior knowledge of the camera. */
export class CameraPanel {
  private readonly optics = select(OPTICS);
  private readonly model = select([]);
  private readonly looks = select(CAMERA_ORIENTATIONS);
  private readonly flipped = checkbox();
  private readonly flat = checkbox();
  private readonly useRim = checkbox();
  private readonly rimRow: HTMLElement;
  private readonly rimWords = h("p", { className: "words" });
  rim: Rim | null = null;

  constructor(
    place: HTMLElement,
    private readonly start: CalibrationOptions,
    changed: () => void,
  ) {
    this.rimRow = h(
      "label",
      { className: "check" },
      this.useRim,
      "Use the mirror rim as initial value and as limit of the field",
    );
    const more = h(
      "details",
      { className: "more" },
      h("summary", {}, "More options"),
      h(
        "div",
        {},
        labelled("Optical axis points", this.looks),
        h(
          "label",
          { className: "check" },
          this.flipped,
          "Camera driver flips images left to right",
        ),
        h("label", { className: "check" }, this.flat, "Assume a perfectly flat and square target"),
      ),
    );
    place.append(
      labelled("Optics", this.optics),
      labelled("Model", this.model),
      this.rimRow,
      this.rimWords,
      more,
    );
    this.offer();
    this.showRim(null);
    this.optics.addEventListener("change", () => this.offer());
    for (const input of [this.optics, this.model, this.looks, this.flipped, this.flat, this.useRim])
      input.addEventListener("change", changed);
  }

  get settings(): Sought {
    const rim = this.rim && this.useRim.checked && this.isMirror ? this.rim : null;
    return {
      model: this.model.value,
      optics: this.optics.value as Sought["optics"],
      camera_looks: this.looks.value as Sought["camera_looks"],
      image_flipped: this.flipped.checked,
      centre_px: rim ? rim.centre : null,
      rim_radius_px: rim ? rim.radius : null,
      flat_board: this.flat.checked,
    };
  }

  get isMirror(): boolean {
    return this.optics.value === "mirror";
  }

  take(settings: Sought, rim: Rim | null): void {
    this.optics.value = settings.optics;
    this.offer();
    this.model.value = settings.model;
    this.looks.value = settings.camera_looks;
    this.flipped.checked = settings.image_flipped;
    this.flat.checked = settings.flat_board;
    this.showRim(rim);
    this.useRim.checked = settings.rim_radius_px !== null;
  }

  /** Display the detected rim; null if there is none. */
  showRim(rim: Rim | null, tried = 0): void {
    const isNew = rim !== null && this.rim === null;
    this.rim = rim;
    if (isNew) this.useRim.checked = true;
    this.rimRow.hidden = rim === null;
    this.rimWords.textContent = rim
      ? `Mirror rim: radius ${words(rim.radius)} px, centre ${words(rim.centre[0])}, ${words(rim.centre[1])} px.`
      : tried
        ? "No reliable mirror rim was detected; the initial centre is the image centre."
        : "";
  }

  private offer(): void {
    const before = this.model.value || "auto";
    const kinds = modelsFor(this.start, this.optics.value as Sought["optics"]);
    this.model.replaceChildren(
      ...kinds.map((kind) => h("option", { value: kind }, modelWords(kind))),
    );
    this.model.value = kinds.includes(before) ? before : "auto";
  }
}

const select = (all: [string, string][]): HTMLSelectElement =>
  h("select", {}, ...all.map(([value, text]) => h("option", { value }, text)));
const checkbox = (): HTMLInputElement => h("input", { type: "checkbox" });
