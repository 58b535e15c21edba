import { h, labelled } from "../../shared/dom";
import type { BoardSpec } from "../../shared/messages";
import { COUNTED, printCommand } from "../formatting";

const KINDS: [BoardSpec["kind"], string][] = [
  ["chessboard", "Chessboard"],
  ["charuco", "ChArUco board"],
  ["aprilgrid", "AprilGrid"],
];

/** Target of the images. */
export class BoardPanel {
  private readonly kind = h(
    "select",
    {},
    ...KINDS.map(([value, text]) => h("option", { value }, text)),
  );
  private readonly columns = number({ min: "2", max: "200", step: "1", value: "11" });
  private readonly rows = number({ min: "2", max: "200", step: "1", value: "7" });
  private readonly square = number({ min: "0.001", step: "any", value: "30" });
  private readonly marker = number({ min: "0", step: "any", placeholder: "¾" });
  private readonly spacing = number({ min: "0.01", max: "1", step: "any", value: "0.3" });
  private readonly family: HTMLSelectElement;
  private readonly legacy = h("input", { type: "checkbox" });
  private readonly counted = h("span", {});
  private readonly problem = h("p", { className: "problem", role: "alert", hidden: true });
  private readonly command = h("code", { tabIndex: 0 });
  private readonly ofMarkers: HTMLElement[];
  private readonly ofCharuco: HTMLElement[];
  private readonly ofApril: HTMLElement[];

  constructor(
    place: HTMLElement,
    families: readonly string[],
    private readonly changed: () => void,
    copy: (text: string) => void,
  ) {
    this.family = h(
      "select",
      {},
      h("option", { value: "" }, "usual"),
      ...families.map((name) => h("option", { value: name }, name)),
    );
    this.columns.setAttribute("aria-label", "Columns");
    this.rows.setAttribute("aria-label", "Rows");
    const size = h(
      "div",
      { className: "field" },
      this.counted,
      h(
        "div",
        { className: "size" },
        this.columns,
        h("span", { "aria-hidden": "true" }, "×"),
        this.rows,
      ),
    );
    const markers = labelled("Markers", this.family);
    const marker = labelled("Marker, mm", this.marker);
    const spacing = labelled("Gap / tag size", this.spacing);
    const legacy = h(
      "label",
      { className: "check" },
      this.legacy,
      "Legacy layout (before OpenCV 4.6)",
    );
    [this.ofMarkers, this.ofCharuco, this.ofApril] = [[markers], [marker, legacy], [spacing]];
    const print = h(
      "details",
      { className: "more" },
      h("summary", {}, "Print a target"),
      h(
        "div",
        {},
        h(
          "p",
          { className: "words" },
          "This command writes the target to scale. Print it at 100 %, mount it on a flat plate, and measure a square.",
        ),
        this.command,
        h(
          "button",
          {
            type: "button",
            className: "small",
            onclick: () => copy(this.command.textContent ?? ""),
          },
          "Copy command",
        ),
      ),
    );
    place.append(
      labelled("Type", this.kind),
      size,
      labelled("Square, mm", this.square),
      markers,
      marker,
      legacy,
      spacing,
      this.problem,
      print,
    );
    for (const input of [
      this.kind,
      this.columns,
      this.rows,
      this.square,
      this.marker,
      this.spacing,
      this.family,
      this.legacy,
    ])
      input.addEventListener("change", () => this.change());
    this.show();
  }

  /** Target; null if the entries are invalid. */
  get board(): BoardSpec | null {
    const inputs = [this.columns, this.rows, this.square, this.marker, this.spacing];
    if (inputs.some((input) => !input.checkValidity()) || !(this.square.valueAsNumber > 0))
      return null;
    const kind = this.kind.value as BoardSpec["kind"];
    return {
      kind,
      columns: this.columns.valueAsNumber,
      rows: this.rows.valueAsNumber,
      square_mm: this.square.valueAsNumber,
      marker_mm: kind === "charuco" && this.marker.value ? this.marker.valueAsNumber : null,
      spacing: kind === "aprilgrid" ? this.spacing.valueAsNumber : 0.3,
      family: kind !== "chessboard" && this.family.value ? this.family.value : null,
      legacy: kind === "charuco" && this.legacy.checked,
    };
  }

  take(board: BoardSpec): void {
    this.kind.value = board.kind;
    [this.columns.value, this.rows.value, this.square.value, this.spacing.value] = [
      board.columns,
      board.rows,
      board.square_mm,
      board.spacing,
    ].map(String);
    this.marker.value = board.marker_mm === null ? "" : String(board.marker_mm);
    this.family.value = board.family ?? "";
    this.legacy.checked = board.legacy;
    this.show();
  }

  private change(): void {
    this.show();
    this.changed();
  }

  private show(): void {
    const kind = this.kind.value as BoardSpec["kind"];
    this.counted.textContent = COUNTED[kind];
    for (const part of this.ofMarkers) part.hidden = kind === "chessboard";
    for (const part of this.ofCharuco) part.hidden = kind !== "charuco";
    for (const part of this.ofApril) part.hidden = kind !== "aprilgrid";
    const { board } = this;
    this.problem.hidden = board !== null;
    this.problem.textContent = board
      ? ""
      : "Columns and rows must be 2 to 200; the square size must be greater than 0 mm.";
    for (const input of [this.columns, this.rows, this.square])
      input.setAttribute("aria-invalid", String(!input.checkValidity()));
    if (board) this.command.textContent = printCommand(board);
  }
}

const number = (properties: Record<string, unknown>): HTMLInputElement =>
  h("input", { type: "number", ...properties });
