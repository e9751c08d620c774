#include "telenano/nve_server/app/serve/surface_keeper.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdio>
#include <filesystem>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/common/rt/background.h"
#include "telenano/common/rt/spsc_queue.h"
#include "telenano/common/surface/gsf.h"
#include "telenano/nve_server/physics/surface/mark_journal.h"
#include "telenano/nve_server/physics/surface/stroke_history.h"

namespace telenano::app {
namespace {

// The copies follow so closely, and a queue holds what a fast hand presses meanwhile many times over: some
// thousand marks a second.
constexpr std::chrono::milliseconds kLook{100};
constexpr std::size_t kMarksWaiting = 8192;

// A scene's name is free text.
bool not_for_a_file(char c) {
  return std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '-' && c != '_';
}

std::string stem_of(const std::string& scene) {
  std::string name = scene;
  std::replace_if(name.begin(), name.end(), not_for_a_file, '_');
  return name;
}

/// The highest number of `stem`-NUMBER.gsf in `folder`, also of one that was not finished; 0: none.
int highest_number(const std::string& folder, const std::string& stem) {
  int highest = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(stem + "-")) continue;
    const char* const begin = name.data() + stem.size() + 1;
    const char* const end = name.data() + name.size();
    int number = 0;
    const auto [rest, error] = std::from_chars(begin, end, number);
    if (error != std::errc()) continue;
    const std::string suffix(rest, end);
    if (suffix == ".gsf" || suffix == ".gsf.part") highest = std::max(highest, number);
  }
  return highest;
}

}  // namespace

/// A session's surface as the keeper's thread has it.
struct SurfaceKeeper::Kept final : physics::MarkJournal {
  void on_mark(const physics::Mark& mark) noexcept override { heard.push({What::kMark, mark}); }
  void on_stroke() noexcept override { heard.push({What::kStroke, {}}); }
  void on_undo() noexcept override { heard.push({What::kUndo, {}}); }

  enum class What : std::uint8_t { kMark, kStroke, kUndo };
  struct Heard {
    What what = What::kMark;
    physics::Mark mark;
  };

  int number = 0;
  rt::SpscQueue<Heard> heard{kMarksWaiting};
  // The keeper's thread's own, once it knows of the session.
  std::unique_ptr<physics::SplineSurface> surface;  // null: no marks yet
  std::unique_ptr<physics::StrokeHistory> strokes;  // of that
  std::string file;                                 // empty: none yet
  bool changed = false;
  bool told = false;
  // Of a session that is over; under the keeper's mutex.
  std::unique_ptr<slave::NveSlave> left;
};

class SurfaceKeeper::KeptSlave final : public slave::Slave {
 public:
  KeptSlave(std::shared_ptr<SurfaceKeeper> keeper, std::shared_ptr<Kept> kept,
            std::unique_ptr<slave::NveSlave> slave)
      : keeper_(std::move(keeper)), kept_(std::move(kept)), slave_(std::move(slave)) {
    slave_->set_mark_journal(kept_.get());
  }
  ~KeptSlave() override { keeper_->take(std::move(kept_), std::move(slave_)); }
  KeptSlave(const KeptSlave&) = delete;
  KeptSlave& operator=(const KeptSlave&) = delete;
  void step(const slave::SlaveInput& input, double dt_s, slave::SlaveOutput& output) noexcept override {
    slave_->step(input, dt_s, output);
  }
  const slave::SlaveLimits& limits() const noexcept override { return slave_->limits(); }
  // So that a station may have its twin.
  std::uint64_t state_hash() const noexcept override { return slave_->state_hash(); }
  std::size_t save(std::span<std::uint8_t> out) const noexcept override { return slave_->save(out); }
  /// A slave that has been loaded is another session for the keeper, with a file of its own: its journal hears
  /// only of the marks that come after these.
  bool load(std::span<const std::uint8_t> bytes) noexcept override {
    try {
      const bool good = slave_->load(bytes);
      slave_->set_mark_journal(nullptr);
      kept_ = keeper_->begin(*slave_, kept_);
      slave_->set_mark_journal(kept_.get());
      return good;
    } catch (...) {  // out of memory
      return false;
    }
  }
  bool say_again(slave::SlaveOutput& output) noexcept override { return slave_->say_again(output); }
  slave::UndoResult undo_marks(std::uint64_t of, slave::SlaveOutput& output) noexcept override {
    return slave_->undo_marks(of, output);
  }
  std::size_t snapshot_bytes_max() const noexcept override { return slave_->snapshot_bytes_max(); }
  std::shared_ptr<const surface::HeightView> heights() const override { return slave_->heights(); }

 private:
  std::shared_ptr<SurfaceKeeper> keeper_;
  std::shared_ptr<Kept> kept_;
  std::unique_ptr<slave::NveSlave> slave_;
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
  try {
    numbers_ = highest_number(folder_, stem_of(scene_->name));
  } catch (const std::filesystem::filesystem_error& e) {
    throw UserError("--save-surface " + folder_ + ": cannot be read: " + e.code().message());
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
  auto slave = keeper->slaves_();
  auto kept = keeper->begin(*slave, nullptr);
  return std::make_unique<KeptSlave>(keeper, std::move(kept), std::move(slave));
}

/// `instead` has left no marks yet.
std::shared_ptr<SurfaceKeeper::Kept> SurfaceKeeper::begin(const slave::NveSlave& slave,
                                                          const std::shared_ptr<Kept>& instead) {
  auto kept = std::make_shared<Kept>();
  kept->number = instead ? instead->number : ++numbers_;
  // Marks that it begins with are in no queue, nor has it counted them: they came with a loaded state.
  if (slave.marked_surface()->marked()) {
    kept->surface = std::make_unique<physics::SplineSurface>(*slave.marked_surface());
    kept->changed = true;
  }
  const std::lock_guard lock(mutex_);
  if (instead) std::erase(sessions_, instead);
  sessions_.push_back(kept);
  return kept;
}

void SurfaceKeeper::take(std::shared_ptr<Kept> kept, std::unique_ptr<slave::NveSlave> slave) noexcept {
  {
    const std::lock_guard lock(mutex_);
    kept->left = std::move(slave);
    news_ = true;
  }
  wake_.notify_all();
}

void SurfaceKeeper::run() {
  using Clock = std::chrono::steady_clock;
  rt::enter_background();
  auto next_save = Clock::now() + kSavePeriod;
  std::vector<std::shared_ptr<Kept>> sessions;
  std::unique_lock lock(mutex_);
  for (;;) {
    wake_.wait_for(lock, kLook, [this] { return done_ || news_; });
    news_ = false;
    const bool over = done_;
    sessions = sessions_;
    std::erase_if(sessions_, [](const std::shared_ptr<Kept>& kept) { return kept->left != nullptr; });
    // Those that are over are this thread's now.
    std::vector<bool> ended;
    for (const auto& kept : sessions) ended.push_back(kept->left != nullptr);
    lock.unlock();
    const bool due = Clock::now() >= next_save;
    if (due) next_save = Clock::now() + kSavePeriod;
    for (std::size_t i = 0; i < sessions.size(); ++i) {
      Kept& kept = *sessions[i];
      if (ended[i]) {
        if (kept.left->marked_surface()->marked()) save(kept, *kept.left->marked_surface());
        continue;
      }
      follow(kept);
      if (due && kept.changed && !kept.told) save(kept, *kept.surface);
    }
    sessions.clear();  // slaves are freed here, outside the lock
    lock.lock();
    if (over && !news_) return;
  }
}

/// Presses what has come into the copy.
void SurfaceKeeper::follow(Kept& kept) const {
  try {
    Kept::Heard next;
    while (!kept.told && kept.heard.pop(next)) {
      if (!kept.surface) {
        kept.surface = std::make_unique<physics::SplineSurface>(
            dynamic_cast<const physics::SplineSurface&>(*scene_->surface));
      }
      physics::SplineSurface& surface = *kept.surface;
      if (!kept.strokes) {
        kept.strokes = std::make_unique<physics::StrokeHistory>(std::vector<std::size_t>{surface.tiles()});
        surface.keep_strokes_in(kept.strokes.get(), 0);
      }
      switch (next.what) {
        case Kept::What::kMark:
          surface.press(next.mark);
          break;
        case Kept::What::kStroke:
          kept.strokes->begin(surface.marked());
          break;
        case Kept::What::kUndo:
          kept.strokes->each_of_last(
              [&](std::size_t, std::size_t tile, double* values) { surface.exchange_tile(tile, values); });
          surface.settle(kept.strokes->marked_before());
          kept.strokes->drop_last();
          break;
      }
      kept.changed = true;
    }
  } catch (const std::exception& error) {
    kept.told = true;
    std::fprintf(stderr, "telenano-nve: warning: %s\n", error.what());
  }
  if (kept.told || kept.heard.dropped() == 0) return;
  kept.told = true;
  std::fprintf(stderr,
               "telenano-nve: warning: marks of session %d came faster than this machine could follow: its "
               "surface is saved only when it ends\n",
               kept.number);
}

std::string SurfaceKeeper::file_of(int number) const {
  return (std::filesystem::path(folder_) / (stem_of(scene_->name) + "-" + std::to_string(number) + ".gsf"))
      .string();
}

void SurfaceKeeper::save(Kept& kept, const physics::SplineSurface& surface) {
  kept.changed = false;
  try {
    surface::Scan scan;
    scan.grid = surface.heights();
    scan.title = scene_->name;
    scan.in_frame_w = true;
    if (!kept.file.empty()) return surface::write_gsf(kept.file, scan);
    while (!surface::create_gsf(file_of(kept.number), scan)) kept.number = ++numbers_;
    kept.file = file_of(kept.number);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "telenano-nve: warning: %s\n", error.what());
  }
}

}  // namespace telenano::app
