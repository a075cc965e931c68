// Form fields: text that reads as numbers, shown shortened while nobody types in it.

import type { ComponentChildren, JSX } from "preact";
import { useId, useState } from "preact/hooks";

import { isNumber } from "../state/numbers";
import { faults } from "../state/store";

/** A long number as it is shown: the exact one stays in the request. */
export function shortened(text: string): string {
  return /^-?\d+\.\d{5,}$/.test(text) ? String(Number(Number(text).toFixed(4))) : text;
}

interface NumberFieldProps {
  readonly label: string;
  readonly unit?: string;
  readonly value: string;
  readonly placeholder?: string;
  readonly name?: string; // accessible name, where the label alone is not enough
  readonly path?: string; // in the request, by which the service names it
  readonly several?: boolean; // one number or six
  readonly onInput: (value: string) => void;
}

export function NumberField({ label, unit, value, placeholder, name, path, several, onInput }: NumberFieldProps): JSX.Element {
  const [typing, setTyping] = useState(false);
  const id = useId();
  const isWrong = !typing && !(several ? value.split(/[\s,;]+/) : [value]).every(isNumber);
  const fault = (path === undefined ? undefined : faultAt(path)) ?? (isWrong ? "not a number" : undefined);
  return (
    <label class={`field ${fault === undefined ? "" : "wrong"}`}>
      <span>
        {label}
        {unit ? <span class="unit"> [{unit}]</span> : null}
      </span>
      <input
        type="text"
        aria-label={name ?? (unit ? `${label} [${unit}]` : label)}
        aria-invalid={fault !== undefined}
        aria-describedby={fault === undefined ? undefined : id}
        title={fault}
        inputMode="decimal"
        autocomplete="off"
        spellcheck={false}
        value={typing ? value : shortened(value)}
        placeholder={placeholder}
        onBlur={() => setTyping(false)}
        onInput={(event) => {
          setTyping(true);
          onInput(event.currentTarget.value);
        }}
      />
      {fault === undefined ? null : <small id={id}>{fault}</small>}
    </label>
  );
}

/** What is wrong with a field: of its own, or of all that it is one of. */
function faultAt(path: string): string | undefined {
  return faults.value[path] ?? faults.value[path.replace(/\[\d+\]$/, "")];
}

interface VectorFieldProps {
  readonly legend: string;
  readonly unit: string;
  readonly names: readonly string[];
  readonly values: readonly string[];
  readonly placeholder?: string;
  readonly path?: string;
  readonly onInput: (values: readonly string[]) => void;
  readonly children?: ComponentChildren;
}

/** Several numbers under one legend. */
export function VectorField({ legend, unit, names, values, placeholder, path, onInput, children }: VectorFieldProps): JSX.Element {
  return (
    <fieldset class="vector">
      <legend>
        {legend} <span class="unit">[{unit}]</span>
        {children}
      </legend>
      <div class={`numbers of-${names.length}`}>
        {names.map((name, i) => (
          <NumberField
            key={name}
            label={name}
            name={`${legend === "Target" ? "" : `${legend} `}${name} [${unit}]`}
            value={values[i] ?? ""}
            {...(placeholder === undefined ? {} : { placeholder })}
            {...(path === undefined ? {} : { path: `${path}[${i}]` })}
            onInput={(value) => onInput(values.map((old, j) => (j === i ? value : old)))}
          />
        ))}
      </div>
    </fieldset>
  );
}

interface ChoiceProps<T extends string> {
  readonly legend: string;
  readonly name: string;
  readonly options: readonly (readonly [T, string])[];
  readonly value: T;
  readonly onChoose: (value: T) => void;
}

/** One of a few: radio buttons that look like one bar. */
export function Choice<T extends string>({ legend, name, options, value, onChoose }: ChoiceProps<T>): JSX.Element {
  return (
    <fieldset class="choice">
      <legend>{legend}</legend>
      <div class="bar">
        {options.map(([key, text]) => (
          <label key={key}>
            <input type="radio" name={name} value={key} checked={key === value} onChange={() => onChoose(key)} />
            <span>{text}</span>
          </label>
        ))}
      </div>
    </fieldset>
  );
}

interface SelectProps<T extends string> {
  readonly label: string;
  readonly options: readonly (readonly [T, string])[];
  readonly value: T;
  readonly onChoose: (value: T) => void;
}

export function SelectField<T extends string>({ label, options, value, onChoose }: SelectProps<T>): JSX.Element {
  return (
    <label class="field">
      <span>{label}</span>
      <select aria-label={label} value={value} onChange={(event) => onChoose(event.currentTarget.value as T)}>
        {options.map(([key, text]) => (
          <option key={key} value={key}>
            {text}
          </option>
        ))}
      </select>
    </label>
  );
}
