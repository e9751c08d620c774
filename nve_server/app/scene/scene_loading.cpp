#include "telenano/nve_server/app/scene/scene_loading.h"

#include <unistd.h>

#include <chrono>
#include <cstdio>

#include "telenano/nve_server/app/serve/server_signals.h"
#include "telenano/nve_server/app/serve/service_notify.h"
#include "telenano/nve_server/scene/fields_cache.h"

namespace telenano::app {

namespace {

const std::shared_ptr<const scene::Scene>& scene_of(const std::shared_ptr<const scene::Scene>& scene) {
  return scene;
}
const std::shared_ptr<const scene::Scene>& scene_of(const scene::SceneWithBundle& both) {
  return both.scene;
}

using Tell = std::function<void(const std::string&)>;

template <class Load>
auto loaded(const Tell& tell, const Load& load) {
  using Clock = std::chrono::steady_clock;
  constexpr std::chrono::seconds kQuiet{2};  // what is made in less needs no word on the way
  const auto begin = Clock::now();
  auto next = begin + kQuiet;
  scene::SceneLoading loading;
  loading.fields_cache = scene::FieldsCache::folder_of_user();
  loading.progress = [&](double part) {
    if (asked_to_stop()) throw StoppedWhileLoading{};
    if (Clock::now() < next || part >= 1.0) return;
    next = Clock::now() + kQuiet;
    char text[96];
    std::snprintf(text, sizeof text, "making the fields of the surface: %.0f %%", 100 * part);
    tell(text);
  };
  auto result = load(loading);
  const scene::Scene& scene = *scene_of(result);
  if (scene.potential && !scene.ground.fields_from_cache) {
    const std::chrono::duration<double> spent = Clock::now() - begin;
    char text[160];
    std::snprintf(text, sizeof text, "fields of the surface made in %.3g s, %.3g MB%s", spent.count(),
                  1e-6 * static_cast<double>(scene.ground.fields_bytes),
                  loading.fields_cache.empty() ? ", not kept (TELENANO_CACHE)" : "");
    tell(text);
  }
  return result;
}

void tell_stderr(const std::string& text) {
  std::fprintf(stderr, "telenano-nve: %s\n", text.c_str());
}

}  // namespace

std::shared_ptr<const scene::Scene> load_scene(const std::string& name_or_path, const Tell& tell) {
  return loaded(tell,
                [&](const scene::SceneLoading& loading) { return scene::load_scene(name_or_path, loading); });
}

std::shared_ptr<const scene::Scene> load_scene(const std::string& name_or_path) {
  // A command's error output is for its errors, but for who looks on.
  const bool watched = ::isatty(STDERR_FILENO) != 0;
  return load_scene(name_or_path, watched ? Tell(tell_stderr) : Tell([](const std::string&) {}));
}

scene::SceneWithBundle load_scene_with_bundle(const std::string& name_or_path) {
  const Tell tell = [](const std::string& text) {
    tell_stderr(text);
    notify_start_goes_on(text);
  };
  return loaded(tell, [&](const scene::SceneLoading& loading) {
    return scene::load_scene_with_bundle(name_or_path, loading);
  });
}

}  // namespace telenano::app
