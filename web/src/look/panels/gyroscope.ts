import { background } from "../../shared/background";
import { allow, byId } from "../../shared/dom";
import { say } from "../../shared/notices";
import { wrapped } from "../../shared/numbers";
import type { Store } from "../../shared/store";
import { aimOf, type Orientation } from "../geometry/device_orientation";

const WAIT_MS = 1500; // timeout for the first orientation event
const STEEP_DEG = 80; // pitch limit for pan: the heading of a horizontal device is undefined
const NOT_TOLD = "This device does not report its orientation.";
const REFUSED =
  "Access to motion sensors was denied. Allow it for this page in the browser settings, and try again.";
const NOT_SAFE = "Browsers report the device orientation only to local pages and over https.";

/** Safari requires a permission after a user action. */
type Asking = { requestPermission?: () => Promise<"granted" | "denied"> };

/** View that follows the orientation of a device. */
export class GyroscopePanel {
  private readonly button = byId<HTMLButtonElement>("gyroscope");
  private last: number | null = null;
  private waiting = 0;
  private readonly onOrientation = (e: DeviceOrientationEvent): void => this.follow(e);

  constructor(private readonly store: Store) {
    this.button.hidden = !matchMedia("(any-pointer: coarse)").matches;
    this.button.addEventListener("click", () => background(this.isOn ? this.stop() : this.start()));
    if (!isSecureContext) allow(this.button, NOT_SAFE);
    else allow(this.button, "DeviceOrientationEvent" in window ? null : NOT_TOLD);
  }

  private get isOn(): boolean {
    return this.button.getAttribute("aria-pressed") === "true";
  }

  private async start(): Promise<void> {
    if (this.button.getAttribute("aria-disabled") === "true") return say(this.button.title);
    const { requestPermission } = DeviceOrientationEvent as unknown as Asking;
    const answer = requestPermission
      ? await requestPermission.call(DeviceOrientationEvent).catch(() => "denied")
      : "granted";
    if (answer !== "granted") return say(REFUSED);
    this.button.setAttribute("aria-pressed", "true");
    this.last = null;
    addEventListener("deviceorientation", this.onOrientation);
    clearTimeout(this.waiting);
    this.waiting = window.setTimeout(() => this.give(), WAIT_MS);
  }

  private stop(): void {
    clearTimeout(this.waiting);
    removeEventListener("deviceorientation", this.onOrientation);
    this.button.setAttribute("aria-pressed", "false");
  }

  /** Stop and disable the control: a device that sends no events has no orientation sensor. */
  private give(): void {
    this.stop();
    allow(this.button, NOT_TOLD);
    say(NOT_TOLD);
  }

  /** Pan by the change of heading, so that dragging remains possible; tilt is absolute. */
  private follow({ alpha, beta, gamma }: DeviceOrientationEvent): void {
    if (alpha === null || beta === null || gamma === null) return;
    clearTimeout(this.waiting);
    const { heading, tilt } = aimOf({ alpha, beta, gamma } satisfies Orientation);
    const isSteep = Math.abs(tilt) > STEEP_DEG;
    const turned = this.last === null || isSteep ? 0 : wrapped(heading - this.last);
    this.last = isSteep ? null : heading;
    this.store.set({ pan: this.store.state.pan + turned, tilt });
  }
}
