/** Function of Node used by tests; its type package is not a dependency. */
declare module "node:child_process" {
  export function execFileSync(
    file: string,
    args: string[],
    options: { env: Record<string, string>; encoding: "utf8" },
  ): string;
}
