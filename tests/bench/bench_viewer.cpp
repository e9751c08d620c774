// Frames of the viewer without a display, up to a window of 4K: a scan of 256 × 256 or 1024 × 1024, what a session of 10 s leaves in the charts,
// and a tip that moves in every frame. Rendered on whatever EGL gives, llvmpipe where there is no graphics
// card.
#include <benchmark/benchmark.h>
#include <epoxy/gl.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <vector>

#include "telenano/master/viewer/offscreen.h"
#include "telenano/master/viewer/viewer.h"
#include "tests/support/view_scene.h"

namespace {

using namespace telenano;

void BM_Frame(benchmark::State& state) {
  const viewer::OffscreenContext context;
  view_model::ViewPort port;
  viewer::Viewer shown(support::view_facts(),
                       view_model::Ground(support::view_scan(static_cast<int>(state.range(2)))), port,
                       static_cast<float>(state.range(3)));
  const int width_px = static_cast<int>(state.range(0));
  const int height_px = static_cast<int>(state.range(1));
  const viewer::Canvas canvas(width_px, height_px, 0);
  state.SetLabel(reinterpret_cast<const char*>(glGetString(GL_RENDERER)));
  std::int64_t tick = 0;
  const auto run_to = [&](std::int64_t end) {
    for (; tick < end; ++tick) {
      port.samples.push(support::view_sample(tick));
      if (tick % 4000 == 0) shown.take_samples();
    }
  };
  run_to(10'000);
  std::vector<double> frames_ms;
  const std::clock_t worked = std::clock();  // of all threads: llvmpipe has one a processor
  for (auto _ : state) {
    const auto began = std::chrono::steady_clock::now();
    run_to(tick + 16);  // at 1 kHz and 60 frames/s
    ImGui::GetIO().DeltaTime = 1.0f / 60;
    canvas.bind();
    shown.take_samples();
    shown.draw(width_px, height_px, 1e-3 * static_cast<double>(tick), {});
    glFinish();
    frames_ms.push_back(
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - began).count());
  }
  std::sort(frames_ms.begin(), frames_ms.end());
  const auto at = [&](double part) {
    return frames_ms[static_cast<std::size_t>(part * static_cast<double>(frames_ms.size() - 1))];
  };
  state.counters["cpu_ms"] = 1e3 * static_cast<double>(std::clock() - worked) / CLOCKS_PER_SEC /
                             static_cast<double>(frames_ms.size());
  state.counters["p50_ms"] = at(0.5);
  state.counters["p99_ms"] = at(0.99);
  state.counters["frames_per_s"] = 1e3 / at(0.5);
}
BENCHMARK(BM_Frame)
    ->ArgNames({"wide", "high", "scan", "scale"})
    ->Args({800, 600, 256, 1})
    ->Args({1280, 800, 256, 1})
    ->Args({1280, 800, 1024, 1})
    ->Args({3840, 2160, 256, 1})
    ->Args({3840, 2160, 256, 2})
    ->Unit(benchmark::kMillisecond)
    ->MinTime(3)
    ->UseRealTime();

}  // namespace
