import { background } from "../../shared/background";
import * as api from "../../shared/api";

/** One active request; only the newest pending one is kept. */
export class Newest<Asked, Found> {
  private waiting: Asked | null = null;
  private isAsking = false;

  constructor(
    private readonly send: (asked: Asked) => Promise<Found>,
    private readonly answered: (found: Found, asked: Asked) => void,
    private readonly refused: (sentence: string) => void,
  ) {}

  /** Return true if no request is active or pending. */
  get isAtRest(): boolean {
    return !this.isAsking && this.waiting === null;
  }

  ask(asked: Asked): void {
    this.waiting = asked;
    if (!this.isAsking) background(this.next());
  }

  private async next(): Promise<void> {
    this.isAsking = true;
    while (this.waiting !== null) {
      const asked = this.waiting;
      this.waiting = null;
      try {
        this.answered(await this.send(asked), asked);
      } catch (e) {
        if (api.isForeseen(e)) this.refused(e.message);
        else reportError(e);
      }
    }
    this.isAsking = false;
  }
}
