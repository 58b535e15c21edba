import { background } from "../../shared/background";
import * as api from "../../shared/api";
import { h, svg } from "../../shared/dom";
import type { BoardSpec, BoardDetection, MultiImageSummary } from "../../shared/messages";
import { openedWebcam, videoInputs } from "../../shared/media";
import { cellsOf, crosses, movedBy } from "../drawing";

const STILL = 0.008; // maximum displacement of a motionless target, relative to the longer image side
const REST_MS = 120; // ms between two detections
const PAUSE_MS = 700; // ms after a failed request

interface Callbacks {
  board: () => BoardSpec | null;
  /** Joint analysis of the images and the current webcam frame. */
  analysis: (candidate: BoardDetection) => Promise<MultiImageSummary>;
  take: (image: Blob) => Promise<boolean>;
  closed: () => void;
  fail: (e: unknown) => void;
}

/** Live webcam: detected corners, recommended position, and automatic capture. */
export class WebcamPane {
  readonly element: HTMLElement;
  private readonly stage = h("div", { className: "live" });
  private readonly overlay = svg("svg", { "aria-hidden": "true" });
  private readonly status = h("p", { className: "advice", role: "status" });
  private readonly auto = h("input", { type: "checkbox", checked: true });
  private readonly which = h("select", {
    "aria-label": "Webcam device",
    hidden: true,
  });
  private video: HTMLVideoElement | null = null;
  private close = (): void => {};
  private before: BoardDetection | null = null;
  private isCaptureRequested = false;
  private number = 0;
  private running = new AbortController();

  constructor(private readonly callbacks: Callbacks) {
    const buttons = h(
      "div",
      { className: "row" },
      h(
        "button",
        { type: "button", className: "primary", onclick: () => (this.isCaptureRequested = true) },
        "Capture image",
      ),
      h("button", { type: "button", onclick: () => this.stop() }, "Close webcam"),
      this.which,
    );
    this.element = h(
      "section",
      { className: "plot webcam", "aria-label": "Webcam", hidden: true },
      this.stage,
      this.status,
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
      const { video, device, close } = await openedWebcam(id, (message) => {
        this.stop();
        this.callbacks.fail(new api.RequestRejected(message));
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
      this.callbacks.fail(e);
    }
  }

  stop(): void {
    this.number++;
    this.running.abort();
    this.running = new AbortController();
    this.close();
    this.close = () => {};
    this.video = this.before = null;
    this.isCaptureRequested = false;
    this.stage.replaceChildren();
    this.element.hidden = true;
    this.callbacks.closed();
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
        this.say(api.isUserError(e) ? e.message : "This image could not be processed.");
        await rest(PAUSE_MS);
      }
    }
  }

  private async look(number: number): Promise<void> {
    const board = this.callbacks.board();
    if (!board || document.hidden) return;
    const frame = await frameOf(this.video!);
    if (this.isCaptureRequested) return this.take(frame, "Taken.");
    const detection = await api.look(
      frame,
      { ...board, name: "the image", fast: true },
      this.running.signal,
    );
    const analysis = await this.callbacks.analysis(detection);
    if (number !== this.number) return;
    this.draw(detection, analysis);
    const isStill = movedBy(this.before, detection) < STILL;
    this.before = detection;
    if (detection.reason !== null)
      return this.say(
        `${advice(analysis) || "Hold the target in front of the camera."} Status: ${detection.reason}.`,
      );
    if (analysis.candidate_reason !== null)
      return this.say(advice(analysis) || `Move the target: ${analysis.candidate_reason}.`);
    if (!isStill) return this.say("Good position; hold the target still.");
    if (this.auto.checked) return this.take(frame, "Image captured. Move the target.");
    this.say("Good position; capture an image.");
  }

  private async take(frame: Blob, words: string): Promise<void> {
    this.isCaptureRequested = false;
    this.before = null;
    this.say(
      (await this.callbacks.take(frame)) ? words : "The maximum number of images is reached.",
    );
  }

  private draw(detection: BoardDetection, { coverage }: MultiImageSummary): void {
    const [width, height] = detection.image_size;
    this.overlay.setAttribute("viewBox", `-0.5 -0.5 ${width} ${height}`);
    const size = Math.max(width, height) / 140;
    const empty = coverage
      ? cellsOf(coverage).filter((cell) => cell.count < coverage.min_corners)
      : [];
    this.overlay.replaceChildren(
      svg("path", { class: "wanted", d: empty.map((cell) => cell.path).join("") }),
      svg("path", { class: "corners", d: crosses(detection.corners_px, size) }),
    );
  }

  private say(message: string): void {
    if (this.status.textContent !== message) this.status.textContent = message;
  }
}

/** Return the recommended next position of the target. */
const advice = ({ advice: all }: MultiImageSummary): string =>
  all.find((message) => !message.startsWith("Capture more images")) ?? "";
const rest = (ms: number): Promise<void> => new Promise((resolve) => setTimeout(resolve, ms));

async function frameOf(video: HTMLVideoElement): Promise<Blob> {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [video.videoWidth, video.videoHeight];
  canvas.getContext("2d")!.drawImage(video, 0, 0);
  const frame = await new Promise<Blob | null>((resolve) => canvas.toBlob(resolve, "image/png"));
  if (!frame)
    throw new api.RequestRejected("The browser could not capture the image of the camera.");
  return frame;
}
