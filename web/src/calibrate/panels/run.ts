import { ServerTask } from "../../shared/api";
import { h, unique } from "../../shared/dom";
import type {
  BoardDetection,
  CalibrationRequest,
  CalibrationResult,
  CalibrationStatus,
} from "../../shared/messages";

const STOP = "stop";
const STOPPING = "Stopping with the best camera so far…";

/** Input of a calibration, and its callbacks. */
interface Callbacks {
  request: () => { ask: CalibrationRequest; detections: BoardDetection[] } | null;
  result: (result: CalibrationResult) => void;
  onReport: (report: string) => void;
}

/** Control of a calibration: start, progress, early stop. */
export class RunPanel {
  private readonly task = new ServerTask<CalibrationStatus>();
  private hasFound = false;
  private readonly reason = h("p", { className: "words", id: unique() });
  private readonly begin = h(
    "button",
    { type: "button", className: "primary", onclick: () => this.start() },
    "Calibrate",
  );
  private readonly min_corners = h(
    "button",
    { type: "button", hidden: true, onclick: () => this.end() },
    "Stop and keep the result",
  );
  private readonly cancel = h(
    "button",
    { type: "button", hidden: true, onclick: () => this.over("Cancelled.") },
    "Cancel",
  );
  private readonly bar = h("progress", {
    max: 1,
    hidden: true,
    "aria-label": "Calibration",
  });
  private readonly status = h("p", { className: "words", role: "status" });

  constructor(
    place: HTMLElement,
    private readonly callbacks: Callbacks,
  ) {
    this.begin.setAttribute("aria-describedby", this.reason.id);
    place.append(
      h("div", { className: "row" }, this.begin, this.min_corners, this.cancel),
      this.reason,
      this.bar,
      this.status,
    );
  }

  /** Enable the start, or display the reason against it. */
  show(reason: string | null): void {
    this.reason.textContent = reason ?? "";
    this.reason.hidden = reason === null;
    this.begin.disabled = this.task.isActive || reason !== null;
  }

  /** Cancel a calibration whose images changed. */
  forget(): void {
    if (this.task.isActive) this.over("The images changed; start the calibration again.");
    else this.status.textContent = "";
  }

  private start(): void {
    const request = this.callbacks.request();
    if (!request) return;
    this.hasFound = false;
    const onInterruption = () =>
      this.over(
        this.hasFound
          ? "Calibration complete; the report could not be written."
          : "The calibration was interrupted; start it again.",
      );
    this.task.begin(
      "api/calibrate/work",
      [request.ask, ...request.detections],
      (status) => this.onStatus(status),
      onInterruption,
    );
    this.running(true);
    this.status.textContent = "Starting…";
  }

  private onStatus(status: CalibrationStatus): void {
    if (status.state === "running" || status.state === "waiting") {
      this.bar.value = status.fraction ?? 0;
      if (!this.min_corners.disabled) this.status.textContent = `${status.message}…`;
    } else if (status.state === "done") {
      this.hasFound = true;
      this.callbacks.result(status.result!);
      this.min_corners.hidden = true;
      this.bar.removeAttribute("value");
      this.status.textContent = "Calibration complete. Writing the report…";
    } else if (status.state === "report") {
      this.over("Done.");
      this.callbacks.onReport(status.report!);
    } else
      this.over(
        `${status.message[0].toUpperCase()}${status.message.slice(1).replace(/\.?$/, ".")}`,
      );
  }

  /** Stop with the best camera so far. */
  private end(): void {
    this.task.tell(STOP);
    this.min_corners.disabled = true;
    this.status.textContent = STOPPING;
  }

  private over(message: string): void {
    this.task.end();
    this.running(false);
    this.status.textContent = message;
  }

  private running(isRunning: boolean): void {
    this.begin.disabled = isRunning || !this.reason.hidden;
    this.min_corners.hidden = this.cancel.hidden = this.bar.hidden = !isRunning;
    this.min_corners.disabled = false;
    this.bar.removeAttribute("value");
  }
}
