/** Return an element of the page, which must exist. */
export const byId = <T extends Element = HTMLElement>(id: string): T =>
  document.getElementById(id) as unknown as T;

type Child = Node | string | null;

/** Create an element with properties and children. */
export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  properties: Record<string, unknown> = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value as EventListener);
    else if (name in element) (element as unknown as Record<string, unknown>)[name] = value;
    else element.setAttribute(name, String(value));
  }
  element.append(...children.filter((c) => c !== null));
  return element;
}

/** Create an SVG element. */
export function svg(
  tag: string,
  attributes: Record<string, string | number>,
  ...children: Child[]
): SVGElement {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...children.filter((c) => c !== null));
  return element;
}

/** Enable a button, or disable it with a reason in its tooltip and accessible description. */
export function allow(button: HTMLButtonElement, reason: string | null): void {
  const does = (button.dataset.does ??= button.title);
  button.title = reason ?? does;
  button.setAttribute("aria-disabled", String(reason !== null));
}

/** Close a menu by Escape, and by a click elsewhere. */
export function closeOutside(menu: HTMLDetailsElement): void {
  document.addEventListener(
    "click",
    (e) => !menu.contains(e.target as Node) && (menu.open = false),
  );
  menu.addEventListener("keydown", (e) => e.key === "Escape" && (menu.open = false));
}

/** Hide elements that require a server. */
export function hideComputed(place: ParentNode): void {
  for (const element of place.querySelectorAll<HTMLElement>("[data-computes]"))
    element.hidden = true;
}

/** Parse data embedded in the page; null if absent. */
export function embeddedData<Data>(name: string): Data | null {
  const result = document.getElementById(name)?.textContent;
  return result ? (JSON.parse(result) as Data) : null;
}

let count = 0;

/** Return a unique element id. */
export const unique = (): string => `b${++count}`;

/** Create a form field: an input with its label. */
export function labelledField(title: string, input: HTMLElement): HTMLElement {
  input.id ||= unique();
  return h("div", { className: "field" }, h("label", { htmlFor: input.id }, title), input);
}

/** Create a section with a heading. */
export function titledSection(title: string, ...children: Child[]): HTMLElement {
  const id = unique();
  return h("section", { "aria-labelledby": id }, h("h3", { id }, title), ...children);
}

/** Steps right and down of the arrow keys. */
export const ARROW_STEPS: Record<string, readonly [number, number]> = {
  ArrowRight: [1, 0],
  ArrowLeft: [-1, 0],
  ArrowDown: [0, 1],
  ArrowUp: [0, -1],
};

/** Return the value of a colour variable. */
export const colour = (name: string): string =>
  getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

/** Save bytes as a file. */
export function save(blob: Blob, name: string): void {
  const link = h("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** Create a group of radio buttons. */
export function choices<T extends string>(
  place: HTMLElement,
  name: string,
  all: readonly (readonly [T, string])[],
  chosen: (value: T) => void,
): (value: T) => void {
  const inputs = new Map<T, HTMLInputElement>();
  for (const [value, text] of all) {
    const label = document.createElement("label");
    const input = Object.assign(document.createElement("input"), { type: "radio", name, value });
    input.addEventListener("change", () => chosen(value));
    label.append(input, Object.assign(document.createElement("span"), { textContent: text }));
    place.append(label);
    inputs.set(value, input);
  }
  return (value) => {
    const input = inputs.get(value);
    if (input) input.checked = true;
  };
}

/** Set the text of an element if it differs; the text node is reused, because new nodes cause a layout. */
export function write(element: Element, text: string): void {
  if (element.textContent === text) return;
  if (element.childNodes.length === 1 && element.firstChild instanceof Text)
    element.firstChild.data = text;
  else element.textContent = text;
}

/** Set the text of an element by id. */
export const put = (id: string, text: string): void => write(byId(id), text);

/** Show or hide an element if its state differs. */
export function reveal(element: HTMLElement, isShown: boolean): void {
  if (element.hidden === isShown) element.hidden = !isShown;
}
