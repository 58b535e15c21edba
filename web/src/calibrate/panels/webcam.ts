import { background } from "../../shared/background";
import * as api from "../../shared/api";
import { h, svg } from "../../shared/dom";
import type { BoardSpec, BoardDetection, MultiImageSummary } from "../../shared/messages";
import { openedWebcam, videoInputs } from "../../shared/media";
import { cellsOf, crosses, movedBy } from "../drawing";

const STILL = 0.008; // maximum displacement of a motionless target, relative to the longer image side
const REST_MS = 120; // ms between two detections
const PAUSE_MS = 700; // ms after a failed request

interface Hands {
  board: () => BoardSpec | null;
  /** Joint analysis of the images and the current webcam frame. */
  together: (candidate: BoardDetection) => Promise<MultiImageSummary>;
  take: (picture: Blob) => Promise<boolean>;
  closed: () => void;
  fail: (e: unknown) => void;
}

/** Live webcam: detected corners, recommended position, and automatic capture. */
export class WebcamPane {
  readonly element: HTMLElement;
  private readonly stage = h("div", { className: "live" });
  private readonly overlay = svg("svg", { "aria-hidden": "true" });
  private readonly said = h("p", { className: "advice", role: "status" });
  private readonly auto = h("input", { type: "checkbox", checked: true });
  private readonly which = h("select", {
    "aria-label": "Webcam device",
    hidden: true,
  });
  private video: HTMLVideoElement | null = null;
  private close = (): void => {};
  private before: BoardDetection | null = null;
  private wanted = false;
  private number = 0;
  private looking = new AbortController();

  constructor(private readonly hands: Hands) {
    const buttons = h(
      "div",
      { className: "row" },
      h(
        "button",
        { type: "button", className: "primary", onclick: () => (this.wanted = true) },
        "Capture image",
      ),
      h("button", { type: "button", onclick: () => this.stop() }, "Close webcam"),
      this.which,
    );
    this.element = h(
      "section",
      { className: "plot webcam", "aria-label": "Webcam", hidden: true },
      this.stage,
      this.said,
      h(
        "label",
        { className: "check" },
        this.auto,
        "Capture automatically when the target is sharp, motionless and at a new position",
      ),
      buttons,
    );
    this.which.addEventListener("change", () => background(this.open(this.which.value)));
  }

  get isOpen(): boolean {
    return this.video !== null;
  }

  async open(id = ""): Promise<void> {
    this.stop();
    const number = ++this.number;
    this.element.hidden = false;
    this.say("Waiting for the camera…");
    try {
      const { video, device, close } = await openedWebcam(id, (sentence) => {
        this.stop();
        this.hands.fail(new api.Refused(sentence));
      });
      if (number !== this.number) return close();
      [this.video, this.close] = [video, close];
      this.overlay.setAttribute("viewBox", `-0.5 -0.5 ${video.videoWidth} ${video.videoHeight}`);
      this.stage.replaceChildren(video, this.overlay);
      await this.offer(device);
      if (number !== this.number) return;
      this.say("Hold the target in front of the camera.");
      background(this.run(number));
    } catch (e) {
      if (number !== this.number) return;
      this.stop();
      this.hands.fail(e);
    }
  }

  stop(): void {
    this.number++;
    this.looking.abort();
    this.looking = new AbortController();
    this.close();
    this.close = () => {};
    this.video = this.before = null;
    this.wanted = false;
    this.stage.replaceChildren();
    this.element.hidden = true;
    this.hands.closed();
  }

  private async offer(device: string): Promise<void> {
    const cameras = await videoInputs();
    this.which.replaceChildren(
      ...cameras.map((d, i) => new Option(d.label || `Camera ${i + 1}`, d.deviceId)),
    );
    this.which.value = device;
    this.which.hidden = cameras.length < 2;
  }

  /** Detect the target repeatedly, one frame at a time. */
  private async run(number: number): Promise<void> {
    while (number === this.number) {
      try {
        await this.look(number);
        await rest(REST_MS);
      } catch (e) {
        if (number !== this.number) return;
        this.say(api.isForeseen(e) ? e.message : "This image could not be processed.");
        await rest(PAUSE_MS);
      }
    }
  }

  private async look(number: number): Promise<void> {
    const board = this.hands.board();
    if (!board || document.hidden) return;
    const frame = await frameOf(this.video!);
    if (this.wanted) return this.take(frame, "Taken.");
    const seen = await api.look(
      frame,
      { ...board, name: "the image", quick: true },
      this.looking.signal,
    );
    const together = await this.hands.together(seen);
    if (number !== this.number) return;
    this.draw(seen, together);
    const isStill = movedBy(this.before, seen) < STILL;
    this.before = seen;
    if (seen.reason !== null)
      return this.say(
        `${advice(together) || "Hold the target in front of the camera."} Status: ${seen.reason}.`,
      );
    if (together.not_new !== null)
      return this.say(advice(together) || `Move the target: ${together.not_new}.`);
    if (!isStill) return this.say("Good position; hold the target still.");
    if (this.auto.checked) return this.take(frame, "Image captured. Move the target.");
    this.say("Good position; capture an image.");
  }

  private async take(frame: Blob, words: string): Promise<void> {
    this.wanted = false;
    this.before = null;
    this.say((await this.hands.take(frame)) ? words : "The maximum number of images is reached.");
  }

  private draw(seen: BoardDetection, { coverage }: MultiImageSummary): void {
    const [width, height] = seen.image_size;
    this.overlay.setAttribute("viewBox", `-0.5 -0.5 ${width} ${height}`);
    const size = Math.max(width, height) / 140;
    const empty = coverage ? cellsOf(coverage).filter((cell) => cell.count < coverage.enough) : [];
    this.overlay.replaceChildren(
      svg("path", { class: "wanted", d: empty.map((cell) => cell.path).join("") }),
      svg("path", { class: "corners", d: crosses(seen.corners_px, size) }),
    );
  }

  private say(sentence: string): void {
    if (this.said.textContent !== sentence) this.said.textContent = sentence;
  }
}

/** Return the recommended next position of the target. */
const advice = ({ advice: all }: MultiImageSummary): string =>
  all.find((sentence) => !sentence.startsWith("Capture more images")) ?? "";
const rest = (ms: number): Promise<void> => new Promise((resolve) => setTimeout(resolve, ms));

async function frameOf(video: HTMLVideoElement): Promise<Blob> {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [video.videoWidth, video.videoHeight];
  canvas.getContext("2d")!.drawImage(video, 0, 0);
  const frame = await new Promise<Blob | null>((resolve) => canvas.toBlob(resolve, "image/png"));
  if (!frame) throw new api.Refused("The browser could not capture the image of the camera.");
  return frame;
}
