#include "nve_server/app/surface_keeper.h"

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <filesystem>
#include <utility>

#include "common/base/error.h"
#include "common/surface/gsf.h"

namespace telenano::app {
namespace {

// A scene's name is free text.
bool not_for_a_file(char c) {
  return std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '-' && c != '_';
}

}  // namespace

class SurfaceKeeper::KeptSlave final : public slave::Slave {
 public:
  KeptSlave(std::shared_ptr<SurfaceKeeper> keeper, Left left)
      : keeper_(std::move(keeper)), left_(std::move(left)) {}
  ~KeptSlave() override { keeper_->take(std::move(left_)); }
  KeptSlave(const KeptSlave&) = delete;
  KeptSlave& operator=(const KeptSlave&) = delete;
  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override {
    left_.slave->step(input, dt_s, output);
  }
  const slave::SlaveLimits& limits() const noexcept override { return left_.slave->limits(); }

 private:
  std::shared_ptr<SurfaceKeeper> keeper_;
  Left left_;
};

SurfaceKeeper::SurfaceKeeper(std::shared_ptr<const scene::Scene> scene, std::string folder)
    : scene_(std::move(scene)), folder_(std::move(folder)) {
  std::error_code error;
  if (!std::filesystem::is_directory(folder_, error)) {
    throw UserError("--save-surface " + folder_ + ": is not a folder");
  }
  if (!scene_->marks) {
    throw UserError(scene_->path +
                    ": --save-surface needs a sample that keeps marks: give [sample] hardness_gpa");
  }
  slaves_ = slave::nve_slaves(scene_);
  thread_ = std::thread([this] { run(); });
}

SurfaceKeeper::~SurfaceKeeper() {
  {
    const std::lock_guard lock(mutex_);
    done_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

std::unique_ptr<slave::Slave> SurfaceKeeper::make_slave(const std::shared_ptr<SurfaceKeeper>& keeper) {
  Left left{++keeper->made_, keeper->slaves_()};
  return std::make_unique<KeptSlave>(keeper, std::move(left));
}

void SurfaceKeeper::take(Left left) noexcept {
  try {
    const std::lock_guard lock(mutex_);  // held elsewhere only to swap the list
    left_.push_back(std::move(left));
  } catch (...) {  // out of memory: this surface is lost, the sessions that run go on
  }
  wake_.notify_all();
}

void SurfaceKeeper::run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    wake_.wait(lock, [this] { return done_ || !left_.empty(); });
    if (left_.empty()) return;
    const std::vector<Left> now = std::exchange(left_, {});
    lock.unlock();
    for (const Left& left : now) write(left);
    lock.lock();
  }
}

void SurfaceKeeper::write(const Left& left) const {
  if (!left.slave || left.slave->sample().marks() == 0) return;
  try {
    surface::Scan scan;
    scan.grid = left.slave->marked_surface()->heights();
    scan.title = scene_->name;
    std::string name = scene_->name;
    std::replace_if(name.begin(), name.end(), not_for_a_file, '_');
    const auto file = std::filesystem::path(folder_) / (name + "-" + std::to_string(left.number) + ".gsf");
    surface::write_gsf(file.string(), scan);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "telenano-nve: warning: %s\n", error.what());
  }
}

}  // namespace telenano::app
