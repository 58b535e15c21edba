import { words } from "../../shared/numbers";
import type { Found } from "../found";
import { interpolated } from "../plots/cursor";
import { type BendHands, handle, place } from "./handle";

/** What of a drawing to scale is needed here. */
interface Drawing {
  readonly scale: number;
  at: (point: [z: number, x: number]) => [left: number, top: number];
}

const AT = [0.45, 0.75, 1]; // of the rim radius

/** Handles on the mirror in cross-section: pulled along the axis, the profile goes through where they are. */
export class ProfileHandles {
  isHeld = false;
  private readonly elements: HTMLElement[];
  private scale = 1;
  private places: [z: number, x: number][] = [];
  private from: readonly [z: number, x: number] = [0, 0];

  constructor(over: HTMLElement, hands: BendHands) {
    this.elements = AT.map((_, i) =>
      handle("profile", "Mirror: drag along the axis to bend its profile", {
        begin: () => {
          this.from = this.places[i];
          this.isHeld = true;
        },
        move: (right) => hands.bend({ of: "profile", at: this.from[1], to: this.from[0] + right / this.scale }),
        end: () => {
          this.isHeld = false;
          hands.letGo();
        },
      }),
    );
    over.append(...this.elements);
  }

  lay(drawing: Drawing, found: Found): void {
    this.scale = drawing.scale;
    const { rim_radius_mm: rim, not_optimised: reason } = found.facts!;
    const table = found.block("mirror");
    const canBend = reason === null && table !== null;
    this.elements.forEach((element, i) => {
      element.hidden = !canBend;
      if (!canBend) return;
      const x = AT[i] * rim;
      this.places[i] = [interpolated(table.column("x_mm"), table.column("z_mm"), x), x];
      const [left, top] = drawing.at(this.places[i]);
      place(element, left, top, this.places[i][0], `z ${words(this.places[i][0])} mm at x ${words(x)} mm`);
    });
  }
}
