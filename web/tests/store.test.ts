/** State and address follow each other. */
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { Store } from "../src/shared/store";

let pages: string[];
let leave: () => void;
let follow: () => void;
let stored: Map<string, string>;

/** Fake browser as required by the store. */
function browse(hash: string, way = "navigate"): void {
  pages = [hash];
  const location = {
    pathname: "/",
    search: "",
    get hash() {
      return pages.at(-1)!;
    },
  };
  const only = (url: string): string => (url.startsWith("#") ? url : "");
  vi.stubGlobal("location", location);
  vi.stubGlobal("history", {
    pushState: (_: unknown, __: string, url: string) => pages.push(only(url)),
    replaceState: (_: unknown, __: string, url: string) => (pages[pages.length - 1] = only(url)),
  });
  vi.stubGlobal("window", globalThis);
  vi.stubGlobal("addEventListener", (event: string, act: () => void) => {
    if (event === "pagehide") leave = act;
    else follow = act;
  });
  vi.stubGlobal("sessionStorage", {
    getItem: (key: string) => stored.get(key) ?? null,
    setItem: (key: string, text: string) => stored.set(key, text),
  });
  vi.stubGlobal("performance", { getEntriesByType: () => [{ type: way }] });
}

beforeEach(() => {
  stored = new Map();
  vi.useFakeTimers();
});
afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

test("a change is told at once, and in the address soon", () => {
  browse("#pan=5");
  const store = new Store();
  const onStatus: string[][] = [];
  store.listen((_, changed) => onStatus.push([...changed]));
  store.set({ pan: 20 });
  store.set({ pan: 30, tilt: 4 });
  store.set({ pan: 30 });
  expect(onStatus).toEqual([["pan"], ["pan", "tilt"]]);
  expect(pages).toEqual(["#pan=5"]);
  vi.runAllTimers();
  expect(pages).toEqual(["#pan=30&tilt=4"]);
});

test("another kind of view is another page of the history, and Back leads to where the first one was left", () => {
  browse("");
  const store = new Store();
  store.set({ pan: 20 });
  store.set({ mode: "dome" });
  expect(pages).toEqual(["#pan=20", "#mode=dome&pan=20"]);
  store.set({ source: "room" }, false); // without a history entry
  vi.runAllTimers();
  expect(pages).toEqual(["#pan=20", "#source=room&mode=dome&pan=20"]);
  pages.pop();
  const changes: Set<string>[] = [];
  store.listen((_, changed) => changes.push(changed));
  follow();
  expect(store.state).toMatchObject({ mode: "panorama", pan: 20, source: "" });
  expect(changes).toEqual([new Set(["source", "mode"])]);
});

test("a link that was entered changes what is seen, keeps the design, and says what it holds that cannot be", () => {
  browse("");
  const store = new Store();
  store.set({ tab: "design", design: "{}" });
  let entered = 0;
  store.entered = () => entered++;
  pages.push("#mode=cube&pan=7");
  follow();
  expect(store.state).toMatchObject({ pan: 7, design: "{}", tab: "look" });
  expect(store.error).toContain("got cube");
  follow(); // second event of the same change
  expect(entered).toBe(1);
});

test("a reload brings back what was changed a moment before; a link that is opened does not", () => {
  browse("#pan=5");
  const store = new Store();
  store.leaving = () => store.set({ tilt: 9 }); // number in a field without a change event
  store.set({ pan: 20 });
  leave();
  expect(pages).toEqual(["#pan=20&tilt=9"]);
  browse("#pan=5", "reload");
  expect(new Store().state).toMatchObject({ pan: 20, tilt: 9 });
  browse("#pan=5", "navigate");
  expect(new Store().state).toMatchObject({ pan: 5, tilt: 0 });
});

test("browsers that keep nothing, or take no more addresses, lose only that", () => {
  browse("#pan=5");
  const refuse = (): never => {
    throw new DOMException("no", "SecurityError");
  };
  vi.stubGlobal("sessionStorage", { getItem: refuse, setItem: refuse });
  vi.stubGlobal("history", { pushState: refuse, replaceState: refuse });
  const store = new Store();
  store.set({ pan: 20 });
  leave();
  expect(store.state.pan).toBe(20);
});
