import type { CurveEdit } from "../../shared/messages";
import type { Design } from "../model/design";
import type { EditCallbacks } from "./handle";

/** Interface of the Design tab for manual deformation. */
interface Callbacks {
  /** Current design in editable form. */
  now: () => Design;
  ask: (from: Design, editCurve: CurveEdit) => void;
  isPending: () => boolean;
  /** Commit the result; successive key presses on one handle are one undo step. */
  settle: (control: string | null) => void;
}

/** Manual deformation of a mirror; each request refers to the mirror at the start of the drag. */
export class CurveEditing implements EditCallbacks {
  private from: Design | null = null;
  private isHeld = false;
  private edited = "";
  private control: string | null = null;

  constructor(private readonly callbacks: Callbacks) {}

  get isActive(): boolean {
    return this.from !== null;
  }

  editCurve(editCurve: CurveEdit): void {
    this.from ??= this.callbacks.now();
    this.isHeld = true;
    this.edited = `${editCurve.of} ${editCurve.at}`;
    this.callbacks.ask(this.from, editCurve);
  }

  release(isByKey: boolean): void {
    this.isHeld = false;
    this.control = isByKey ? this.edited : null;
    this.onEvaluation();
  }

  /** Commit after the release, when no request is pending. */
  onEvaluation(): void {
    if (!this.from || this.isHeld || this.callbacks.isPending()) return;
    this.from = null;
    this.callbacks.settle(this.control);
  }
}
