// The page: header with Stop, scene with the request beside it, timeline, and what there is to know below.

import type { JSX } from "preact";

import { guided } from "./state/store";
import { Banners } from "./views/banners";
import { CalibrationSection } from "./views/calibration";
import { CertificateSection } from "./views/certificate";
import { ExecutionSection } from "./views/execution";
import { Header } from "./views/header";
import { HistorySection } from "./views/history";
import { JobSection } from "./views/job";
import { MapSection } from "./views/map";
import { RobotsSection } from "./views/robots";
import { SceneSection } from "./views/scene";
import { ThrowPanel } from "./views/throw";
import { TimelineSection } from "./views/timeline";

export function App(): JSX.Element {
  const guides = guided.value;
  const execution = <ExecutionSection key="execution" />;
  const calibration = <CalibrationSection key="calibration" />;
  return (
    <>
      <Header />
      <main>
        <Banners />
        <div class="stage">
          <SceneSection />
          <ThrowPanel />
          <div class="side">
            {guides ? [calibration, execution] : [execution, calibration]}
            <MapSection />
          </div>
          <TimelineSection />
        </div>
        <div class="below">
          <CertificateSection />
          <JobSection />
          <HistorySection />
          <RobotsSection />
        </div>
      </main>
    </>
  );
}
