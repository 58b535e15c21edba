import type { Evaluation, EvaluationOptions } from "../evaluation";
import type { LocalEvaluator } from "./evaluator";

/** Evaluation requests answered by the page; only the newest pending request of each slot is kept. */
export class LocalEvaluationQueue {
  private readonly waiting = new Map<number, { options: EvaluationOptions; request: number }>();
  private number = 0;

  constructor(
    private readonly evaluator: LocalEvaluator,
    private readonly onEvaluation: (result: Evaluation) => void,
  ) {}

  /** Request an evaluation; replaces a pending request of the same slot. */
  ask(slot: number, options: EvaluationOptions): void {
    if (this.waiting.size === 0) setTimeout(() => this.answer());
    this.waiting.set(slot, { options, request: performance.now() });
  }

  isPending(slot: number): boolean {
    return this.waiting.has(slot);
  }

  private answer(): void {
    const questions = [...this.waiting].sort(([a], [b]) => a - b);
    this.waiting.clear();
    for (const [slot, { options, request }] of questions)
      this.onEvaluation(
        this.evaluator.answer({ slot, number: ++this.number, ...options }, request),
      );
  }
}
