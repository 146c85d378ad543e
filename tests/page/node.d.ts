// The types of node's test runner that the tests use; the complete ones would need another package.
declare module "node:test" {
  export function test(name: string, run: () => unknown): Promise<void>;
  export const mock: {
    method(object: object, name: string, instead: () => unknown): void;
    timers: { enable(options: { apis: string[] }): void; tick(ms: number): void; reset(): void };
  };
}

declare module "node:assert/strict" {
  const assert: {
    ok(value: unknown, message?: string): asserts value;
    equal(actual: unknown, expected: unknown, message?: string): void;
    deepEqual(actual: unknown, expected: unknown, message?: string): void;
    match(actual: string, expected: RegExp, message?: string): void;
    rejects(promise: Promise<unknown>, expected: (error: any) => boolean): Promise<void>;
  };
  export default assert;
}

declare module "node:fs" {
  export function readdirSync(folder: URL, options: { recursive: true }): string[];
  export function readFileSync(file: URL, encoding: "utf8"): string;
}

declare function setImmediate(act: (value: unknown) => void): void;

interface ImportMeta {
  url: string;
}
