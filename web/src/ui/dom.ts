/** An element of the page; the page is known to have it. */
export const byId = <T extends Element = HTMLElement>(id: string): T => document.getElementById(id) as unknown as T;

let fading = 0;

/** Say something in passing. */
export function say(sentence: string): void {
  const said = byId("said");
  said.textContent = sentence;
  said.classList.add("shown");
  clearTimeout(fading);
  fading = window.setTimeout(() => said.classList.remove("shown"), 4000);
}

/** Say something that stays until it is over. */
export function banner(sentence: string | null): void {
  const place = byId("banner");
  place.hidden = !sentence;
  if (place.textContent !== (sentence ?? "")) place.textContent = sentence ?? "";
}

export function busy(sentence: string | null): void {
  byId("busy").hidden = !sentence;
  byId("busy").textContent = sentence ?? "";
}

/** Save bytes under a name. */
export function save(blob: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

export async function copy(text: string, what: string): Promise<void> {
  try {
    await navigator.clipboard.writeText(text);
    say(`${what} copied`);
  } catch {
    say(`The browser does not let pages copy; here it is: ${text}`);
  }
}

/** A group of choices of which one holds. */
export function choices<T extends string>(place: HTMLElement, name: string, all: readonly (readonly [T, string])[], chosen: (value: T) => void): (value: T) => void {
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
