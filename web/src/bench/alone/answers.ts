import type { Found, Wish } from "../found";
import type { Answerer } from "./answer";

/** Evaluation requests answered by the page; only the newest pending request of each slot is kept. */
export class AnswersAlone {
  private readonly waiting = new Map<number, { wish: Wish; asked: number }>();
  private number = 0;

  constructor(
    private readonly answerer: Answerer,
    private readonly answered: (found: Found) => void,
  ) {}

  /** Request an evaluation; replaces a pending request of the same slot. */
  ask(slot: number, wish: Wish): void {
    if (this.waiting.size === 0) setTimeout(() => this.answer());
    this.waiting.set(slot, { wish, asked: performance.now() });
  }

  isAsked(slot: number): boolean {
    return this.waiting.has(slot);
  }

  private answer(): void {
    const questions = [...this.waiting].sort(([a], [b]) => a - b);
    this.waiting.clear();
    for (const [slot, { wish, asked }] of questions)
      this.answered(this.answerer.answer({ slot, number: ++this.number, ...wish }, asked));
  }
}
