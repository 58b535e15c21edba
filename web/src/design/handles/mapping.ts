import { reveal } from "../../shared/dom";
import { words } from "../../shared/numbers";
import type { Area, Curves, Over } from "../plots/charts";
import { interpolated } from "../plots/cursor";
import { type EditCallbacks, handle, place } from "./handle";

const AT = [0.25, 0.5, 0.75]; // fractions of the field

/** Handles on the curve of image height; the mapping is deformed to pass through them. */
export class MappingHandles implements Over {
  isHeld = false;
  private readonly elements: HTMLElement[];
  private area: Area | null = null;
  private curve: Curves | null = null;
  private start: { omega: number; top: number } = { omega: 0, top: 0 };

  constructor(private readonly callbacks: EditCallbacks) {
    this.elements = AT.map((share) =>
      handle("point", "Image height: drag up or down to bend the mapping", {
        begin: () => this.begin(share),
        move: (_, down) =>
          callbacks.editCurve({
            of: "mapping",
            at: this.start.omega,
            to: this.area!.value(this.start.top + down),
          }),
        end: (isByKey) => this.end(isByKey),
      }),
    );
  }

  reach(): number[] {
    return [];
  }

  layOut(area: Area, first: Curves | null): void {
    this.area = area;
    this.curve = first?.of.evaluation.summary?.not_optimised === null ? first : null;
    AT.forEach((share, i) => {
      const element = this.elements[i];
      reveal(element, this.curve !== null);
      if (!this.curve) return;
      if (!element.isConnected) area.layer.append(element);
      const [omega, height] = this.at(share);
      place(
        element,
        area.across(omega),
        area.down(height),
        height,
        `${words(height)} px at ${words(omega, 3)}°`,
      );
    });
  }

  private at(share: number): [omega: number, height: number] {
    const { omega, values } = this.curve!;
    const [low, high] = [omega[0], omega[omega.length - 1]];
    const at = low + share * (high - low);
    return [at, interpolated(omega, values[0], at)];
  }

  private begin(share: number): void {
    const [omega, height] = this.at(share);
    this.start = { omega, top: this.area!.down(height) };
    this.isHeld = true;
  }

  private end(isByKey: boolean): void {
    this.isHeld = false;
    this.callbacks.release(isByKey);
  }
}
