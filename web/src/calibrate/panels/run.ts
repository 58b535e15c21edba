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
interface Hands {
  given: () => { ask: CalibrationRequest; pictures: BoardDetection[] } | null;
  found: (found: CalibrationResult) => void;
  reported: (report: string) => void;
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
  private readonly enough = h(
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
  private readonly said = h("p", { className: "words", role: "status" });

  constructor(
    place: HTMLElement,
    private readonly hands: Hands,
  ) {
    this.begin.setAttribute("aria-describedby", this.reason.id);
    place.append(
      h("div", { className: "row" }, this.begin, this.enough, this.cancel),
      this.reason,
      this.bar,
      this.said,
    );
  }

  /** Enable the start, or display the reason against it. */
  show(reason: string | null): void {
    this.reason.textContent = reason ?? "";
    this.reason.hidden = reason === null;
    this.begin.disabled = this.task.isUnderWay || reason !== null;
  }

  /** Cancel a calibration whose images changed. */
  forget(): void {
    if (this.task.isUnderWay) this.over("The images changed; start the calibration again.");
    else this.said.textContent = "";
  }

  private start(): void {
    const given = this.hands.given();
    if (!given) return;
    this.hasFound = false;
    const cutOff = () =>
      this.over(
        this.hasFound
          ? "Calibration complete; the report could not be written."
          : "The calibration was interrupted; start it again.",
      );
    this.task.begin(
      "api/calibrate/work",
      [given.ask, ...given.pictures],
      (news) => this.told(news),
      cutOff,
    );
    this.running(true);
    this.said.textContent = "Starting…";
  }

  private told(news: CalibrationStatus): void {
    if (news.state === "running") {
      this.bar.value = news.share ?? 0;
      if (!this.enough.disabled) this.said.textContent = `${news.sentence}…`;
    } else if (news.state === "done") {
      this.hasFound = true;
      this.hands.found(news.found!);
      this.enough.hidden = true;
      this.bar.removeAttribute("value");
      this.said.textContent = "Calibration complete. Writing the report…";
    } else if (news.state === "reported") {
      this.over("Done.");
      this.hands.reported(news.report!);
    } else
      this.over(`${news.sentence[0].toUpperCase()}${news.sentence.slice(1).replace(/\.?$/, ".")}`);
  }

  /** Stop with the best camera so far. */
  private end(): void {
    this.task.tell(STOP);
    this.enough.disabled = true;
    this.said.textContent = STOPPING;
  }

  private over(sentence: string): void {
    this.task.end();
    this.running(false);
    this.said.textContent = sentence;
  }

  private running(isRunning: boolean): void {
    this.begin.disabled = isRunning || !this.reason.hidden;
    this.enough.hidden = this.cancel.hidden = this.bar.hidden = !isRunning;
    this.enough.disabled = false;
    this.bar.removeAttribute("value");
  }
}
