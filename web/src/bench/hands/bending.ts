import type { CurveEdit } from "../../shared/messages";
import type { Design } from "../designs/design";
import type { BendHands } from "./handle";

/** Interface of the bench for manual deformation. */
interface Hands {
  /** Current design in editable form. */
  now: () => Design;
  ask: (from: Design, bend: CurveEdit) => void;
  isAsked: () => boolean;
  /** Commit the result. */
  settle: () => void;
}

/** Manual deformation of a mirror; each request refers to the mirror at the start of the drag. */
export class Bending implements BendHands {
  private from: Design | null = null;
  private isHeld = false;

  constructor(private readonly hands: Hands) {}

  get isUnderWay(): boolean {
    return this.from !== null;
  }

  bend(bend: CurveEdit): void {
    this.from ??= this.hands.now();
    this.isHeld = true;
    this.hands.ask(this.from, bend);
  }

  letGo(): void {
    this.isHeld = false;
    this.answered();
  }

  /** Commit after the release, when no request is pending. */
  answered(): void {
    if (!this.from || this.isHeld || this.hands.isAsked()) return;
    this.from = null;
    this.hands.settle();
  }
}
