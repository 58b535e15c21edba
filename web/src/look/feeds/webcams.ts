import { byId } from "../../shared/dom";
import { videoInputs } from "../../shared/media";
import { type Feed, webcamFeed } from "./feed";

/** Selection of webcams; browsers list them after permission for the first. */
export class Webcams {
  private readonly select = byId<HTMLSelectElement>("webcams");

  constructor(opened: (id: string) => void) {
    for (const id of ["webcam", "start-webcam"])
      byId(id).addEventListener("click", () => opened(""));
    this.select.addEventListener("change", () => opened(this.select.value));
  }

  /** Open a webcam, or the default one, and list all. */
  async open(id: string, lost: (message: string) => void): Promise<Feed> {
    const feed = await webcamFeed(id, lost);
    const cameras = await videoInputs();
    const option = (d: MediaDeviceInfo, i: number): HTMLOptionElement =>
      new Option(d.label || `Camera ${i + 1}`, d.deviceId);
    this.select.replaceChildren(...cameras.map(option));
    this.select.value = feed.device!;
    byId("webcams-label").hidden = cameras.length < 2;
    return { ...feed, source: String(Math.max(0, this.select.selectedIndex)) };
  }
}
