// Where this arm can throw: the map over the floor, what is coloured, and its legend.

import { useSignal } from "@preact/signals";
import type { JSX } from "preact";

import { goodness, type MapPicture, type MapQuantity, PROVEN, requestOfMap, type Rgb, YES } from "../model/throw-map";
import type { MapRequest, ThrowMap } from "../service/types";
import { cancelMap, loadMap, makeMap } from "../state/actions";
import { cellName, failed, mapPicture, mapQuantity, mapShown, notice, throwMap } from "../state/store";
import { constraintWords, figure } from "../state/words";
import { SelectField } from "./fields";

const QUANTITIES: readonly (readonly [MapQuantity, string])[] = [
  ["release_time_s", "Time of the release"],
  ["landing_shift_10ms_m", "What 10 ms do"],
  ["hit_probability", "Probability of a hit"],
  ["reason", "Why not"],
];
type Width = "0.05" | "0.1" | "0.2" | "0.5";
const WIDTHS: readonly (readonly [Width, string])[] = [["0.05", "5 cm"], ["0.1", "10 cm"], ["0.2", "20 cm"], ["0.5", "50 cm"]];
const SHADES = [0, 0.25, 0.5, 0.75, 1];

export function MapSection(): JSX.Element {
  const shown = mapShown.value;
  const toggle = (): void => {
    mapShown.value = !shown;
    if (!shown) loadMap().catch((error) => (notice.value = { kind: "bad", text: failed(error) }));
  };
  return (
    <section class="card map" aria-labelledby="map-title">
      <div class="who">
        <h2 id="map-title">Throwability map</h2>
        <button type="button" class="quiet small" aria-pressed={shown} onClick={toggle}>
          {shown ? "Hide map" : "Show map"}
        </button>
      </div>
      {shown ? <MapView map={throwMap.value} picture={mapPicture.value} /> : null}
    </section>
  );
}

function MapView({ map, picture }: { map: ThrowMap | null; picture: MapPicture | null }): JSX.Element {
  return (
    <>
      <p class={map?.state === "void" ? "bad" : "soft"} role="status">{stateWords(map)}</p>
      {map?.state === "running" ? <progress max={map.progress.total} value={map.progress.done} aria-label="Landing cells that are answered" /> : null}
      {map?.state === "running" ? (
        <button type="button" class="quiet small" onClick={() => void cancelMap(map.id)}>
          Cancel map
        </button>
      ) : (
        <Make map={map} />
      )}
      {map && picture ? (
        <>
          <SelectField label="Colour" options={QUANTITIES} value={mapQuantity.value} onChoose={(quantity) => (mapQuantity.value = quantity)} />
          {mapQuantity.value === "reason" ? <Reasons picture={picture} /> : <Scale picture={picture} quantity={mapQuantity.value} />}
          <p class="hint">A click on the map plans a throw there.</p>
        </>
      ) : null}
    </>
  );
}

/** Begins a map of all that is in range; one that was ended goes on as it is, where it is as fine as asked for. */
function Make({ map }: { map: ThrowMap | null }): JSX.Element {
  const own = WIDTHS.find(([value]) => Number(value) === map?.resolution_m)?.[0];
  const width = useSignal<Width>(own ?? "0.1");
  const same = map !== null && map.state !== "finished" && Number(width.value) === map.resolution_m ? map : null;
  const request: MapRequest = same === null ? { resolution_m: Number(width.value), robust: false } : requestOfMap(same);
  return (
    <div class="numbers of-2">
      <SelectField label="Landing cells" options={WIDTHS} value={width.value} onChoose={(chosen) => (width.value = chosen)} />
      <button type="button" class="quiet small" onClick={() => void makeMap(request)}>
        {same === null ? "Make a map" : same.state === "void" ? "Make it anew" : "Go on"}
      </button>
    </div>
  );
}

function stateWords(map: ThrowMap | null): string {
  if (map === null) return `There is no map of ${cellName.value ?? "this cell"} yet: for each place on the floor the certified throw, or why there is none.`;
  const { done, total } = map.progress;
  const level = map.level_m === null ? "" : `, ${figure(map.level_m * 100, 3)} cm fine so far`;
  if (map.state === "running") return `${done} of ${total} landing cells${level}.`;
  if (map.state === "void") return `This map does not hold any more: ${map.void_because ?? "the cell has changed"}.`;
  if (map.state === "waiting") return `${done} of ${total} landing cells${level}; nobody works on it just now.`;
  if (map.state === "cancelled") return `Ended after ${done} of ${total} landing cells${level}.`;
  const states = map.values.state.flat();
  const [hit, proven] = [YES, PROVEN].map((wanted) => states.filter((state) => state === wanted).length);
  return `${hit} of ${states.length} landing cells can be hit, ${proven} provably not; ${figure(map.resolution_m * 100, 3)} cm wide.`;
}

const css = ([r, g, b]: Rgb): string => `rgb(${r} ${g} ${b})`;

/** The colours from the worst to the best, with their values. */
function Scale({ picture, quantity }: { picture: MapPicture; quantity: MapQuantity }): JSX.Element {
  if (picture.scale === null) return <p class="hint">Nothing is known of this yet.</p>;
  const gradient = `linear-gradient(to right, ${SHADES.map((share) => css(goodness(share))).join(", ")})`;
  return (
    <figure class="map-scale">
      <div aria-hidden="true" style={{ background: gradient }} />
      <figcaption>
        <span>{valueWords(picture.scale[0], quantity)}</span>
        <span>grey: no throw</span>
        <span>{valueWords(picture.scale[1], quantity)}</span>
      </figcaption>
    </figure>
  );
}

function valueWords(value: number, quantity: MapQuantity): string {
  if (quantity === "release_time_s") return `${figure(value, 2)} s`;
  return quantity === "hit_probability" ? `${figure(value * 100, 2)} %` : `${figure(value * 1000, 2)} mm`;
}

function Reasons({ picture }: { picture: MapPicture }): JSX.Element {
  if (picture.reasons.length === 0) return <p class="hint">No landing cell is refused.</p>;
  return (
    <ul class="map-reasons">
      {picture.reasons.map(({ constraint, colour, proven, vain }) => (
        <li key={constraint}>
          <i aria-hidden="true" style={{ background: css(colour) }} />
          {constraintWords(constraint)}
          <span class="soft">{[proven ? `${proven} proven` : "", vain ? `${vain} searched in vain` : ""].filter(Boolean).join(", ")}</span>
        </li>
      ))}
    </ul>
  );
}
