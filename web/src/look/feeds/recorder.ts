import { byId, save } from "../../shared/dom";
import { say } from "../../shared/notices";

const KINDS = [
  "video/mp4;codecs=avc1.640033",
  "video/mp4;codecs=vp9",
  "video/webm;codecs=vp9",
  "video/webm;codecs=vp8",
  "video/webm",
];

/** Record the view as a video. */
export class Recorder {
  private running: MediaRecorder | null = null;

  constructor(
    private readonly view: () => HTMLCanvasElement,
    private readonly started: () => void,
  ) {
    byId("record").addEventListener("click", () => (this.running ? this.stop() : this.start()));
  }

  /** Whether the view must be redrawn continuously, because browsers record changes only. */
  get isRunning(): boolean {
    return this.running !== null;
  }

  /** End and save a recording, if one is running. */
  stop(): void {
    this.running?.stop();
  }

  private start(): void {
    const kind =
      typeof MediaRecorder === "undefined"
        ? undefined
        : KINDS.find((k) => MediaRecorder.isTypeSupported(k));
    if (!kind) return say("This browser does not support recording.");
    const pieces: Blob[] = [];
    const stream = this.view().captureStream(30);
    const release = (): void => stream.getTracks().forEach((track) => track.stop());
    let recorder: MediaRecorder;
    try {
      recorder = new MediaRecorder(stream, { mimeType: kind, videoBitsPerSecond: 12e6 });
      recorder.start(1000);
    } catch {
      release();
      return say("This browser cannot record the view.");
    }
    this.running = recorder;
    recorder.ondataavailable = (e) => pieces.push(e.data);
    recorder.onstop = () => {
      release();
      this.running = null;
      this.show(false);
      save(
        new Blob(pieces, { type: kind }),
        `view.${kind.startsWith("video/mp4") ? "mp4" : "webm"}`,
      );
    };
    this.show(true);
    this.started();
  }

  private show(isRunning: boolean): void {
    const button = byId("record");
    button.textContent = isRunning ? "Stop recording" : "Record";
    button.setAttribute("aria-pressed", String(isRunning));
  }
}
