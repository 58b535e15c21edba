import type { Feed } from "../feeds/feed";
import type { Circle } from "../geometry/camera";
import type { Pixel } from "../../shared/vectors";

const SIDE = 132; // px on the screen
const ENLARGED = 4; // magnification relative to the pane
const RIM = "#ffb454";

/** Magnifier for a dragged handle, which a finger covers. */
export class Magnifier {
  private readonly canvas = Object.assign(document.createElement("canvas"), {
    className: "loupe",
    hidden: true,
  });

  constructor(pane: HTMLElement) {
    this.canvas.setAttribute("aria-hidden", "true");
    pane.append(this.canvas);
  }

  /** Magnify the surroundings of a pixel in the opposite corner; `unit` is the number of image pixels per screen pixel. */
  show({ image, width, height }: Feed, [u, v]: Pixel, circle: Circle, unit: number): void {
    const { canvas } = this;
    const dots = Math.min(devicePixelRatio, 2);
    canvas.width = canvas.height = SIDE * dots;
    canvas.classList.toggle("right", u < width / 2);
    canvas.hidden = false;
    const scale = (ENLARGED * dots) / unit; // per image pixel
    const at = (x: number, about: number): number => canvas.width / 2 + (x - about) * scale;
    const context = canvas.getContext("2d")!;
    context.setTransform(scale, 0, 0, scale, at(-0.5, u), at(-0.5, v));
    context.imageSmoothingEnabled = scale < 3;
    context.drawImage(image, 0, 0, width, height);
    context.resetTransform();
    context.strokeStyle = RIM;
    context.lineWidth = 1.5 * dots;
    context.beginPath();
    context.arc(at(circle.u, u), at(circle.v, v), circle.radius * scale, 0, 2 * Math.PI);
    const [middle, arm] = [canvas.width / 2, 7 * dots];
    context.moveTo(middle - arm, middle);
    context.lineTo(middle + arm, middle);
    context.moveTo(middle, middle - arm);
    context.lineTo(middle, middle + arm);
    context.stroke();
  }

  hide(): void {
    this.canvas.hidden = true;
  }
}
