import { background } from "../../shared/background";
import { byId } from "../../shared/dom";

/** Playback control of a video: pause and seek. */
export class Playback {
  private readonly place = byId("playback");
  private readonly button = byId<HTMLButtonElement>("play");
  private readonly time = byId<HTMLInputElement>("time");
  private video: HTMLVideoElement | null = null;

  constructor() {
    this.button.addEventListener("click", () => this.toggle());
    this.time.addEventListener(
      "input",
      () => this.video && (this.video.currentTime = Number(this.time.value)),
    );
  }

  /** Set the video; null for none, or for one without an end. */
  follow(video: HTMLVideoElement | null): void {
    this.video = video && Number.isFinite(video.duration) ? video : null;
    this.place.hidden = !this.video;
    if (!this.video) return;
    this.time.max = String(this.video.duration);
    const show = (): void => this.show();
    for (const event of ["timeupdate", "play", "pause", "seeked"] as const)
      this.video.addEventListener(event, show);
    show();
  }

  toggle(): void {
    if (!this.video) return;
    if (this.video.paused) background(this.video.play());
    else this.video.pause();
  }

  private show(): void {
    if (!this.video) return;
    const { currentTime: now, duration, paused } = this.video;
    this.button.textContent = paused ? "Play" : "Pause";
    this.time.value = String(now);
    const words = `${clock(now)} of ${clock(duration)}`;
    this.time.setAttribute("aria-valuetext", words);
    byId("time-words").textContent = words;
  }
}

/** Format minutes and seconds. */
const clock = (s: number): string =>
  `${Math.floor(s / 60)}:${String(Math.floor(s % 60)).padStart(2, "0")}`;
