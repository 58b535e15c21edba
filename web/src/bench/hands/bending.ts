import type { Bend } from "../../shared/messages";
import type { Design } from "../designs/design";
import type { BendHands } from "./handle";

/** What bending needs of the bench. */
interface Hands {
  /** The design, as one that may be changed. */
  now: () => Design;
  ask: (from: Design, bend: Bend) => void;
  isAsked: () => boolean;
  /** Settle on what it has become. */
  settle: () => void;
}

/** A mirror that is bent by hand: always the one that was there when it was taken hold of, not what it became on the way. */
export class Bending implements BendHands {
  private from: Design | null = null;
  private isHeld = false;

  constructor(private readonly hands: Hands) {}

  get isUnderWay(): boolean {
    return this.from !== null;
  }

  bend(bend: Bend): void {
    this.from ??= this.hands.now();
    this.isHeld = true;
    this.hands.ask(this.from, bend);
  }

  letGo(): void {
    this.isHeld = false;
    this.answered();
  }

  /** Settle, once it was let go and nothing of it is still asked. */
  answered(): void {
    if (!this.from || this.isHeld || this.hands.isAsked()) return;
    this.from = null;
    this.hands.settle();
  }
}
