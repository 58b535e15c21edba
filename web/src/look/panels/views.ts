import { byId, h } from "../../shared/dom";
import {
  type StoredView,
  MAX_NAME_LENGTH,
  MODES,
  sourceOfState,
  ofView,
  type State,
  SOURCE_KEYS,
  textOf,
  VIEW,
  viewsIn,
} from "../../shared/state";
import type { Store } from "../../shared/store";
import { asShown, type Place } from "../stage";

/** Displayed names of view types. */
const TITLES: Record<State["mode"], string> = {
  panorama: "Panorama",
  perspective: "Perspective",
  dome: "Dome",
  planet: "Little planet",
  ground: "Ground plan",
  mosaic: "Mosaic",
};
export const KINDS = MODES.map((mode) => [mode, TITLES[mode]] as const);
const AROUND = [
  ["Ahead", 0],
  ["Right", 90],
  ["Behind", 180],
  ["Left", -90],
] as const;

/** Stored views: selected individually, or displayed side by side. */
export class ViewsPanel {
  private readonly list = byId("kept-views");
  private readonly analysis = byId<HTMLButtonElement>("all-views");
  private readonly cells = byId("cells");
  private shape = "";

  /** `sources` are the available sources by name. */
  constructor(
    private readonly store: Store,
    private readonly sources: () => readonly { source: string; name: string }[],
  ) {
    byId("keep-view").addEventListener("click", () => this.keep());
    this.analysis.addEventListener("click", () => this.showAll(!store.state.all));
    store.listen((s, changed) => this.follow(s, changed));
    this.show();
  }

  /** Return the displayed views: the current one, or all stored ones. */
  states(): State[] {
    const s = asShown(this.store.state);
    const { stored } = this;
    return s.all && stored.length
      ? stored.map((view, i) =>
          i === this.active ? s : asShown({ ...s, ...ofView(view), ...view.of }),
        )
      : [s];
  }

  /** Return the views of other images or cameras. */
  additional(): State[] {
    return this.states().filter((s) => this.isOther(s));
  }

  /** Return true if the image or camera of a view differs from the main one. */
  isOther(view: State): boolean {
    return SOURCE_KEYS.some((key) => String(view[key]) !== String(this.store.state[key]));
  }

  /** Index of the active view. */
  get active(): number {
    const { all, view } = this.store.state;
    return all ? Math.min(Math.max(view, 0), Math.max(this.stored.length - 1, 0)) : 0;
  }

  /** Activate the view at a position of the canvas, px. */
  chooseAt(places: readonly Place[], x: number, y: number): void {
    const at = places.findIndex(
      (p) => x >= p.left && y >= p.top && x < p.left + p.width && y < p.top + p.height,
    );
    if (at >= 0 && places.length > 1 && at !== this.active) this.go(at);
  }

  /** Label the views, and display errors of missing ones. */
  label(places: readonly Place[], canvas: HTMLElement, doubt: (s: State) => string): void {
    const shown = places.length > 1 ? places : [];
    while (this.cells.children.length > shown.length) this.cells.lastElementChild!.remove();
    while (this.cells.children.length < shown.length)
      this.cells.append(h("div", {}, h("span", {})));
    shown.forEach(({ left, top, width, height, state, cameraFeed }, i) => {
      const cell = this.cells.children[i] as HTMLElement;
      cell.className = i === this.active ? "moved" : "";
      Object.assign(cell.style, {
        left: `${canvas.offsetLeft + left}px`,
        top: `${canvas.offsetTop + top}px`,
        width: `${width}px`,
        height: `${height}px`,
      });
      cell.firstElementChild!.textContent = cameraFeed
        ? this.stored[i].name
        : `${this.stored[i].name}: ${doubt(state)}`;
    });
  }

  private get stored(): StoredView[] {
    return viewsIn(this.store.state.views) ?? [];
  }

  /** Index of the displayed view among the stored ones; -1 if there is none. */
  private get current(): number {
    const s = this.store.state;
    return s.all
      ? this.active
      : this.stored.findIndex(
          ({ of, ...view }) =>
            VIEW.every((key) => view[key] === s[key]) && !this.isOther({ ...s, ...of }),
        );
  }

  private keep(): void {
    const { stored } = this;
    this.store.set({
      views: textOf([...stored, this.named(this.newName())]),
      ...(this.store.state.all && { view: stored.length }),
    });
  }

  /** Return the current view for storage, with its source if there are several. */
  private named(name: string): StoredView {
    const s = this.store.state;
    return { name, ...ofView(s), ...(this.sourceName !== null && { of: sourceOfState(s) }) };
  }

  /** Name of the current source, if there are several. */
  private get sourceName(): string | null {
    const sources = this.sources();
    return (
      (sources.length > 1 &&
        sources.find(({ source }) => source === this.store.state.source)?.name) ||
      null
    );
  }

  private newName(): string {
    const { mode, pan } = this.store.state;
    const name =
      this.sourceName ??
      (mode === "perspective" ? `${TITLES[mode]} ${Math.round(pan)}°` : TITLES[mode]);
    const alike = this.stored.filter(
      (view) => view.name === name || view.name.startsWith(`${name} (`),
    ).length;
    return alike ? `${name} (${alike + 1})` : name;
  }

  private go(index: number): void {
    const view = this.stored[index];
    this.store.set({ ...ofView(view), ...view.of, view: index });
  }

  private drop(index: number): void {
    const rest = this.stored.filter((_, i) => i !== index);
    const isAll = this.store.state.all && rest.length > 0;
    const next = Math.min(this.active, rest.length - 1);
    const view = rest[next];
    this.store.set({
      views: textOf(rest),
      all: isAll,
      view: isAll ? next : -1,
      ...(isAll && { ...ofView(view), ...view.of }),
    });
  }

  private rename(index: number, name: string): void {
    const views = this.stored.map((view, i) =>
      i === index && name.trim() ? { ...view, name: name.trim() } : view,
    );
    this.store.set({ views: textOf(views) });
    this.show();
  }

  /** Display all views; without stored views, those of all sources, or the current view and four directions. */
  private showAll(all: boolean): void {
    if (!all) return this.store.set({ all, view: -1 });
    const s = this.store.state;
    let { stored } = this;
    let { current } = this;
    if (!stored.length && this.sourceName !== null) {
      stored = this.sources().map(({ source, name }) => ({
        name: name.slice(0, MAX_NAME_LENGTH),
        ...ofView(s),
        of: { ...sourceOfState(s), source },
      }));
      current = stored.findIndex(({ of }) => of?.source === s.source);
    }
    if (!stored.length)
      stored = AROUND.map(([name, pan]) => ({
        name,
        ...ofView({ ...s, mode: "perspective", pan, tilt: 0, hfov: 90, zoom: 1 }),
      }));
    if (current < 0) stored = [this.named(this.newName()), ...stored];
    current = Math.max(current, 0);
    this.store.set({ views: textOf(stored), all, view: current });
  }

  /** Store changes of the active view immediately. */
  private follow(s: State, changed: Set<keyof State>): void {
    const isMoved =
      s.all &&
      [...VIEW, ...SOURCE_KEYS].some((key) => changed.has(key)) &&
      !changed.has("view") &&
      !changed.has("views");
    if (isMoved)
      this.store.set({
        views: textOf(
          this.stored.map((view, i) =>
            i === this.active
              ? { name: view.name, ...ofView(s), ...(view.of && { of: sourceOfState(s) }) }
              : view,
          ),
        ),
      });
    if (
      isMoved ||
      [...VIEW, ...SOURCE_KEYS].some((key) => changed.has(key)) ||
      (["views", "view", "all"] as const).some((key) => changed.has(key))
    )
      this.show();
  }

  private show(): void {
    const { stored, current } = this;
    this.analysis.setAttribute("aria-pressed", String(this.store.state.all));
    const shape = JSON.stringify([stored.map((view) => view.name), current]);
    if (shape === this.shape) return;
    this.shape = shape;
    this.list.replaceChildren(...stored.map((view, i) => this.chip(view, i, i === current)));
  }

  private chip({ name }: StoredView, i: number, isCurrent: boolean): HTMLElement {
    if (!isCurrent)
      return h("li", {}, h("button", { type: "button", onclick: () => this.go(i) }, name));
    const input = h("input", {
      type: "text",
      value: name,
      maxLength: 40,
      size: Math.max(4, name.length),
      spellcheck: false,
      "aria-label": "Name of this view",
    });
    input.addEventListener("change", () => this.rename(i, input.value));
    return h(
      "li",
      { className: "current", "aria-current": "true" },
      input,
      h(
        "button",
        {
          type: "button",
          "aria-label": `Remove ${name}`,
          title: "Remove this view",
          onclick: () => this.drop(i),
        },
        "×",
      ),
    );
  }
}
