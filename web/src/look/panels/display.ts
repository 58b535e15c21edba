import { allow, byId } from "../../shared/dom";
import type { State } from "../../shared/state";
import type { Store } from "../../shared/store";
import { asShown } from "../stage";

/** Reasons for fixed sizes of some view types. */
const ALWAYS: Partial<Record<State["mode"], string>> = {
  perspective: "A perspective view always fills the available area.",
  dome: "A dome is circular; enlarging it would hide parts of the view.",
  mosaic: "A mosaic has a fixed aspect ratio.",
};

/** Display options: complete view or filled area, with or without the raw image. */
export class DisplayPanel {
  private readonly fill = byId<HTMLButtonElement>("fill");
  private readonly beside = byId<HTMLButtonElement>("beside");

  constructor(
    private readonly store: Store,
    besides: () => void,
  ) {
    this.fill.addEventListener("click", () =>
      store.set({ fit: asShown(store.state).fit === "fill" ? "whole" : "fill" }),
    );
    this.beside.addEventListener("click", () => store.set({ beside: !store.state.beside }));
    store.listen((_, changed) => {
      this.show();
      if (changed.has("beside")) besides();
    });
    addEventListener("resize", () => this.show());
    this.show();
  }

  private show(): void {
    const s = asShown(this.store.state);
    this.fill.setAttribute("aria-pressed", String(s.fit === "fill"));
    allow(this.fill, ALWAYS[s.mode] ?? null);
    this.beside.setAttribute("aria-pressed", String(s.beside));
  }
}
