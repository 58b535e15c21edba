import { background } from "../../shared/background";
import { h } from "../../shared/dom";
import { loadFailed } from "../../shared/texts";
import type { begin } from "../../space/entry";
import type { SpaceView } from "../../space/view";
import type { Drawn } from "./charts";
import type { Cursor } from "./cursor";

const SCRIPT = import.meta.env.DEV ? "/src/space/entry.ts" : "./space.js";
const WITHOUT = "The 3-D view requires WebGL2, which this browser does not support.";

/** 3-D view of the current design; its script is loaded on first use. */
export class SpacePlot {
  readonly element: HTMLElement;
  view: SpaceView | null = null;
  private readonly place = h("div", { className: "space" });
  private isFetching = false;
  private first: Drawn | null = null;

  constructor(private readonly cursor: Cursor) {
    this.element = h(
      "figure",
      { className: "plot wide" },
      h(
        "figcaption",
        {},
        h("span", {}, "3-D view"),
        h(
          "span",
          { className: "quiet" },
          "chief rays every 15° of the field, in the room of the rendered image",
        ),
      ),
      this.place,
    );
  }

  show(drawn: Drawn[]): void {
    this.first = drawn[0]?.evaluation.block("rays") ? drawn[0] : null;
    if (!this.view) background(this.fetch());
    else if (this.first) this.view.show(this.first.evaluation);
  }

  describe(): void {
    this.view?.describe();
  }

  private async fetch(): Promise<void> {
    if (this.isFetching) return;
    this.isFetching = true;
    const script = await (
      import(/* @vite-ignore */ SCRIPT) as Promise<{ begin: typeof begin }>
    ).catch(() => null);
    this.view =
      script?.begin({ place: this.place, read: (omega) => this.cursor.set(omega, this) }) ?? null;
    if (!this.view)
      this.place.replaceChildren(
        h(
          "p",
          { className: "quiet", role: "status" },
          script ? WITHOUT : loadFailed("The 3-D view"),
        ),
      );
    else if (this.first) this.view.show(this.first.evaluation);
    this.view?.describe();
    this.isFetching = script !== null && !this.view; // missing browser features are permanent
  }
}
