import { background } from "../../shared/background";
import * as api from "../../shared/api";

/** One active request; only the newest pending one is kept. */
export class RequestQueue<Asked, Evaluation> {
  private waiting: Asked | null = null;
  private isAsking = false;

  constructor(
    private readonly send: (request: Asked) => Promise<Evaluation>,
    private readonly onEvaluation: (result: Evaluation, request: Asked) => void,
    private readonly refused: (message: string) => void,
  ) {}

  /** Return true if no request is active or pending. */
  get isAtRest(): boolean {
    return !this.isAsking && this.waiting === null;
  }

  ask(request: Asked): void {
    this.waiting = request;
    if (!this.isAsking) background(this.next());
  }

  private async next(): Promise<void> {
    this.isAsking = true;
    while (this.waiting !== null) {
      const request = this.waiting;
      this.waiting = null;
      try {
        this.onEvaluation(await this.send(request), request);
      } catch (e) {
        if (api.isUserError(e)) this.refused(e.message);
        else reportError(e);
      }
    }
    this.isAsking = false;
  }
}
