import type { Found, Wish } from "../found";
import type { Answerer } from "./answer";

/** Questions about designs, answered by the page itself; of those of one slot the newest. */
export class AnswersAlone {
  private readonly waiting = new Map<number, { wish: Wish; asked: number }>();
  private number = 0;

  constructor(
    private readonly answerer: Answerer,
    private readonly answered: (found: Found) => void,
  ) {}

  /** Ask about a design; an older question of the same slot that still waits is forgotten. */
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
