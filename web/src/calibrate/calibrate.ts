import { background } from "../shared/background";
import * as api from "../shared/api";
import { h } from "../shared/dom";
import type {
  BoardDetection,
  CalibrationOptions,
  CalibrationRequest,
  CalibrationResult,
  MultiImageSummary,
} from "../shared/messages";
import { checkReadable, isVideo } from "../shared/media";
import { framesOf } from "./frames";
import type { Host } from "./host";
import { keepResult, keepSettings, keptResult, keptSettings } from "./kept";
import { BoardPanel } from "./panels/board";
import { CameraPanel, type Rim } from "./panels/camera";
import { RunPanel } from "./panels/run";
import { WebcamPane } from "./panels/webcam";
import { Gallery } from "./results/gallery";
import { coveragePlot } from "./results/plots";
import { list, resultsOf, tablesOf } from "./results/report";
import { Single } from "./results/single";
import { MAX_SHOTS, type Shot, Shots } from "./shots";
import { Toolbar } from "./toolbar";
import { calibrateCommand, rimOf, whyNot } from "./words";

/** Stored state of the panels. */
interface Settings {
  board: NonNullable<BoardPanel["board"]>;
  sought: CameraPanel["sought"];
  rim: Rim | null;
}

const LOOKED_AT_FOR_RIM = 3; // number of images
const TOGETHER_MS = 150;

/** Tab Calibrate: images of a target, detections, and the estimated camera. */
export class Calibrate {
  readonly shots: Shots;
  readonly webcam: WebcamPane;
  found: CalibrationResult | null = null;
  report: string | null = null;
  together: MultiImageSummary | null = null;
  private chosen: Shot | null = null;
  private readonly board: BoardPanel;
  private readonly camera: CameraPanel;
  private readonly run: RunPanel;
  private readonly gallery: Gallery;
  private readonly single: Single;
  private readonly toolbar: Toolbar;
  private readonly invitation: HTMLElement;
  private readonly coverage = h("div", {});
  private readonly state = h("div", { className: "plots state" });
  private readonly next = h("section", {
    className: "next",
    "aria-label": "Recommended next image",
    hidden: true,
  });
  private readonly results = h("div", { className: "results" });
  private readonly tables = h("div", { className: "tables" });
  private readonly command = h("code", { tabIndex: 0 });
  private readonly commandRow: HTMLElement;
  private timer = 0;
  private asked = 0;
  private rimTried = 0;

  constructor(
    private readonly host: Host,
    start: CalibrationOptions,
  ) {
    const fail = (e: unknown): void => this.fail(e);
    this.shots = new Shots({
      board: () => this.board.board,
      changed: () => this.changed(),
      settled: () => background(this.findRim()),
      fail,
    });
    this.gallery = new Gallery((shot) => this.choose(shot));
    this.single = new Single({
      remove: (shot) => this.remove(shot),
      retry: (shot) => this.shots.retry(shot),
      fail,
    });
    this.webcam = new WebcamPane({
      board: () => this.board.board,
      together: (seen) => this.asTogether(seen),
      take: (picture) => this.take(picture, `webcam ${this.shots.all.length + 1}.png`),
      closed: () => this.show(),
      fail,
    });
    this.toolbar = new Toolbar(host, {
      add: (files) => background(this.add(files)),
      webcam: () => background(this.webcam.open()),
      clear: () => this.clear(),
      found: () => this.found,
      report: () => this.report,
      look: () => background(this.look()),
    });
    const [boards, cameras, runs] = [panel("Target"), panel("Camera"), panel("Calibration")];
    this.board = new BoardPanel(
      boards,
      start.families,
      () => this.boardChanged(),
      (text) => host.copy(text),
    );
    this.camera = new CameraPanel(cameras, start, () => this.cameraChanged());
    this.run = new RunPanel(runs, {
      given: () => this.given(),
      found: (found) => this.calibrated(found),
      reported: (report) => this.reported(report),
    });
    this.invitation = this.invite();
    this.commandRow = h(
      "div",
      { className: "command" },
      h("span", { className: "words" }, "Equivalent command"),
      this.command,
      h(
        "button",
        {
          type: "button",
          className: "small",
          onclick: () => host.copy(this.command.textContent ?? ""),
        },
        "Copy",
      ),
    );
    this.state.append(this.coverage, this.next);
    const desk = h(
      "section",
      { className: "desk", tabIndex: -1, "aria-label": "Images and results" },
      this.invitation,
      this.webcam.element,
      this.results,
      this.state,
      this.single.element,
      this.gallery.element,
      this.tables,
      this.commandRow,
    );
    host.place.append(
      h("aside", { "aria-label": "Target, camera and calibration" }, boards, cameras, runs),
      desk,
    );
    this.show();
  }

  /** Restore the stored state. */
  async begin(): Promise<void> {
    const kept = keptSettings<Settings>();
    if (kept?.board && kept.sought) {
      this.board.take(kept.board);
      this.camera.take(kept.sought, kept.rim ?? null);
    }
    const lost = await this.shots.restore();
    if (lost.length)
      this.host.banner(
        `The page was closed before ${lost.join(", ")} ${lost.length > 1 ? "were" : "was"} stored; add ${lost.length > 1 ? "them" : "it"} again.`,
        "calibrate",
      );
    const result = await keptResult(this.keys);
    if (result) [this.found, this.report] = [result.found, result.report];
    this.drawResults();
    this.show();
  }

  /** Add images, or the frames of a video. */
  async add(files: readonly File[]): Promise<void> {
    this.host.banner(null, "calibrate");
    const take = (picture: Blob, name: string, time: number | null): Promise<boolean> =>
      this.take(picture, name, time);
    const refusals: string[] = [];
    for (const file of files) {
      try {
        await checkReadable(file, file.name);
        if (isVideo(file, file.name))
          await framesOf(file, file.name, MAX_SHOTS - this.shots.all.length, take);
        else if (!(await take(file, file.name, null))) {
          refusals.push(
            `${MAX_SHOTS} images is the maximum; ${file.name} and the following files were ignored.`,
          );
          break;
        }
      } catch (e) {
        if (e instanceof api.Refused) refusals.push(e.message);
        else this.fail(e);
      }
    }
    if (refusals.length) this.host.banner(refusals.join(" "), "calibrate");
  }

  private async take(picture: Blob, name: string, time: number | null = null): Promise<boolean> {
    this.drop();
    return this.shots.add(picture, name, time);
  }

  private remove(shot: Shot): void {
    if (this.chosen === shot) this.chosen = null;
    this.drop();
    this.shots.remove(shot);
  }

  private clear(): void {
    this.chosen = null;
    this.drop();
    this.camera.showRim(null);
    this.rimTried = 0;
    this.shots.clear();
  }

  private choose(shot: Shot | null): void {
    this.chosen = this.chosen === shot ? null : shot;
    this.show();
    if (this.chosen) this.single.element.scrollIntoView({ block: "nearest" });
  }

  // -- changes of the input -------------------------------------------------------------------------

  private boardChanged(): void {
    if (!this.board.board) return this.show();
    if (this.shots.again()) this.drop();
    this.keep();
    this.show();
  }

  private cameraChanged(): void {
    this.drop();
    this.changed();
    this.keep();
  }

  /** Discard the result, which is valid for its images only. */
  private drop(): void {
    this.run.forget();
    if (!this.found) return;
    [this.found, this.report] = [null, null];
    this.drawResults();
    this.keep();
  }

  private changed(): void {
    this.show();
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => background(this.compare()), TOGETHER_MS);
  }

  /** Request the joint analysis of the images. */
  private async compare(): Promise<void> {
    const looked = this.shots.all.filter((s) => s.seen !== null);
    const number = ++this.asked;
    if (!looked.length || !this.board.board) {
      if (!this.shots.waiting) this.together = null;
      return this.show();
    }
    try {
      const together = await this.asTogether(null);
      if (number !== this.asked) return;
      this.together = together;
      looked.forEach((shot, i) => (shot.reason = together.reasons[i] ?? null));
    } catch (e) {
      if (number === this.asked) this.fail(e);
    }
    this.show();
  }

  private asTogether(candidate: BoardDetection | null): Promise<MultiImageSummary> {
    const { rim } = this.camera;
    const pictures = this.shots.all.flatMap((s) => (s.seen ? [s.seen] : []));
    return api.together({
      board: this.board.board!,
      pictures,
      centre_px: rim?.centre ?? null,
      radius_px: rim?.radius ?? null,
      candidate,
    });
  }

  /** Detect the mirror rim in the first images with a target. */
  private async findRim(): Promise<void> {
    const looked = this.shots.found.slice(0, LOOKED_AT_FOR_RIM);
    if (
      !this.camera.isMirror ||
      looked.length <= this.rimTried ||
      this.rimTried >= LOOKED_AT_FOR_RIM
    )
      return;
    this.rimTried = looked.length;
    try {
      const rim = rimOf(await Promise.all(looked.map((shot) => api.rim(shot.blob, shot.name))));
      this.camera.showRim(rim, looked.length);
      this.changed();
      this.keep();
    } catch (e) {
      if (!(e instanceof api.Refused)) this.fail(e); // calibration does not require a rim
    }
  }

  // -- calibration ----------------------------------------------------------------------------------

  private given(): { ask: CalibrationRequest; pictures: BoardDetection[] } | null {
    const { board } = this.board;
    const pictures = this.shots.all.flatMap((s) => (s.seen ? [s.seen] : []));
    if (!board || !pictures.length) return null;
    return {
      ask: { board, ...this.camera.sought, pictures: pictures.length, command: this.commandLine() },
      pictures,
    };
  }

  private calibrated(found: CalibrationResult): void {
    this.found = found;
    this.report = null;
    this.drawResults();
    this.show();
    this.keep();
    this.results.scrollIntoView({ block: "start" });
  }

  private reported(report: string): void {
    this.report = report;
    this.show();
    this.keep();
  }

  /** Open the selected image, or the first used one, with the calibrated camera in the tab Look. */
  private async look(): Promise<void> {
    const { found } = this;
    const shot =
      this.chosen ??
      this.shots.all.find((s) => found?.pictures.find((p) => p.name === s.name)?.used);
    if (!found || !shot) return;
    try {
      await this.host.lookThrough(
        new Blob([found.camera_file], { type: "application/toml" }),
        "camera.toml",
        shot.blob,
        shot.name,
      );
    } catch (e) {
      this.fail(e);
    }
  }

  // -- display --------------------------------------------------------------------------------------

  private show(): void {
    const { all } = this.shots;
    const isEmpty = !all.length && !this.webcam.isOpen;
    this.invitation.hidden = !isEmpty;
    this.commandRow.hidden = !all.length;
    this.run.show(
      this.board.board
        ? whyNot(this.shots.found.length, this.shots.waiting)
        : "Specify the target first.",
    );
    this.gallery.show(all, this.chosen);
    this.single.show(this.chosen, this.camera.isMirror ? this.camera.rim : null, this.found);
    this.toolbar.show(all.length > 0);
    this.command.textContent = this.commandLine();
    this.drawCoverage();
  }

  private drawCoverage(): void {
    const shown = this.found?.coverage ?? this.together?.coverage ?? null;
    const used = this.shots.found;
    if (!used.length && this.shots.waiting) return; // buttons are not recreated during detection, so that a press is not lost
    this.coverage.hidden = !shown || !used.length;
    if (shown && used.length)
      this.coverage.replaceChildren(
        coveragePlot(
          shown,
          used[0].seen!.image_size,
          used.flatMap((s) => s.seen!.corners_px),
          this.camera.isMirror ? this.camera.rim : null,
        ),
      );
    const advice = used.length ? (this.found?.advice ?? this.together?.advice ?? []) : [];
    this.next.hidden = !advice.length;
    this.state.hidden = this.coverage.hidden && this.next.hidden;
    this.next.replaceChildren(h("h3", {}, "Next"), list("advice", advice));
  }

  private drawResults(): void {
    const choose = (name: string): void => {
      this.chosen = null;
      this.choose(this.shots.all.find((s) => s.name === name) ?? null);
    };
    this.results.replaceChildren(...(this.found ? resultsOf(this.found) : []));
    this.tables.replaceChildren(...(this.found ? tablesOf(this.found, choose) : []));
  }

  private commandLine(): string {
    const { board } = this.board;
    const files = this.shots.all.filter((s) => s.time === null).map((s) => s.name);
    const videos = [
      ...new Set(
        this.shots.all
          .filter((s) => s.time !== null)
          .map((s) => s.name.replace(/ at [\d.]+ s$/, "")),
      ),
    ];
    return board ? calibrateCommand([...files, ...videos], { board, ...this.camera.sought }) : "";
  }

  private invite(): HTMLElement {
    return h(
      "div",
      { className: "invitation" },
      h("h2", {}, "Drop images of a target here"),
      h(
        "p",
        {},
        "10 to 20 images of one target, distributed over the field and tilted, or a video. They remain on this machine.",
      ),
      h(
        "p",
        { className: "choices" },
        h(
          "button",
          { type: "button", className: "primary", onclick: () => this.toolbar.open() },
          "Choose images…",
        ),
        h(
          "button",
          { type: "button", onclick: () => background(this.webcam.open()) },
          "Use the webcam",
        ),
      ),
    );
  }

  private get keys(): string[] {
    return this.shots.all.map((s) => s.key);
  }

  private keep(): void {
    const { board } = this.board;
    if (board)
      keepSettings({ board, sought: this.camera.sought, rim: this.camera.rim } satisfies Settings);
    background(keepResult(this.keys, this.found, this.report));
  }

  private fail(e: unknown): void {
    if (api.isForeseen(e)) this.host.banner(e.message, e.name === "Away" ? "server" : "calibrate");
    else reportError(e);
  }
}

const panel = (title: string): HTMLElement =>
  h("section", { className: "panel", "aria-label": title }, h("h2", {}, title));
