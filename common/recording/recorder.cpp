#include "telenano/common/recording/recorder.h"

#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <mutex>
#include <span>
#include <thread>
#include <utility>

#include "telenano/common/recording/recording_file.h"
#include "telenano/common/rt/signals_blocked.h"
#include "telenano/common/rt/spsc_queue.h"

namespace telenano::recording {
namespace {

using SteadyTime = std::chrono::steady_clock;
constexpr auto kPollPeriod = std::chrono::milliseconds(10);

/// The writer is never urgent, and signals are for the main thread. Blocking them also turns SIGXFSZ (file
/// size limit) into an ordinary write error.
void become_background_thread() {
  sched_param param{};
  ::pthread_setschedparam(::pthread_self(), SCHED_OTHER, &param);
  ::pthread_setname_np(::pthread_self(), "recorder");
}

}  // namespace

class Recorder::Impl {
 public:
  Impl(const RecorderOptions& options, const Configuration& configuration)
      : options_(options),
        file_(options.path, options.overwrite, configuration),
        samples_(options.queue_rows),
        events_(options.queue_events),
        datagrams_(options.queue_datagrams),
        state_pieces_(options.queue_state_pieces) {
    rows_.reserve(RecordingFile::kChunkRows);
    event_rows_.reserve(RecordingFile::kChunkRows);
    datagram_rows_.reserve(RecordingFile::kChunkRows);
    state_piece_rows_.reserve(RecordingFile::kChunkRows);
    const rt::SignalsBlocked blocked;
    thread_ = std::thread([this] { run(); });
  }

  ~Impl() { close(); }

  template <class Row>
  bool push(rt::SpscQueue<Row>& queue, const Row& row, std::atomic<std::uint64_t>& dropped) noexcept {
    if (!failed_.load(std::memory_order_acquire) && queue.push(row)) return true;
    dropped.store(dropped.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
    return false;
  }
  bool push(const Sample& sample) noexcept { return push(samples_, sample, rows_dropped_); }
  bool push(const Event& event) noexcept { return push(events_, event, events_dropped_); }
  bool push(const DatagramRow& row) noexcept { return push(datagrams_, row, datagrams_dropped_); }
  bool push(const StatePieceRow& row) noexcept {
    // What follows a missing one is of no use either.
    if (state_pieces_taken_ < options_.state_pieces_most && push(state_pieces_, row, state_pieces_dropped_)) {
      ++state_pieces_taken_;
      return true;
    }
    if (std::exchange(state_pieces_taken_, options_.state_pieces_most) == options_.state_pieces_most)
      state_pieces_dropped_.store(state_pieces_dropped_.load(std::memory_order_relaxed) + 1,
                                  std::memory_order_relaxed);
    return false;
  }

  void close() {
    if (!thread_.joinable()) return;
    stop_.store(true, std::memory_order_release);
    thread_.join();
  }

  bool failed() const noexcept { return failed_.load(std::memory_order_acquire); }
  std::string failure() const {
    const std::lock_guard lock(failure_mutex_);
    return failure_;
  }
  std::uint64_t rows_written() const noexcept { return rows_written_.load(std::memory_order_relaxed); }
  std::uint64_t rows_dropped() const noexcept {
    return rows_dropped_.load(std::memory_order_relaxed) + rows_lost_.load(std::memory_order_relaxed);
  }
  std::uint64_t events_dropped() const noexcept { return events_dropped_.load(std::memory_order_relaxed); }
  std::uint64_t datagrams_dropped() const noexcept {
    return datagrams_dropped_.load(std::memory_order_relaxed);
  }
  std::uint64_t state_pieces_dropped() const noexcept {
    return state_pieces_dropped_.load(std::memory_order_relaxed);
  }

 private:
  void run() {
    become_background_thread();
    prepare_hdf5();
    const auto flush_period = std::chrono::duration_cast<SteadyTime::duration>(
        std::chrono::duration<double>(std::max(options_.flush_period_s, 0.0)));
    auto next_flush = SteadyTime::now() + flush_period;
    bool good = true;
    for (bool stopping = false; good && !stopping;) {
      stopping =
          stop_.load(std::memory_order_acquire);  // looked at first: what was pushed before it is still taken
      if (!stopping) std::this_thread::sleep_for(kPollPeriod);
      good = take_all();
      if (good && !stopping && SteadyTime::now() >= next_flush) {
        take_marks();
        good = write_all() && file_.confirm(rows_dropped());
        if (good) rows_written_.store(file_.rows(), std::memory_order_relaxed);
        next_flush = SteadyTime::now() + flush_period;
      }
    }
    if (good) take_marks();
    if (good) good = write_all() && file_.close(rows_dropped());
    if (good) {
      rows_written_.store(file_.rows(), std::memory_order_relaxed);
    } else {
      stop_recording();
    }
  }

  /// Empties the queues into the buffers; full buffers are written at once.
  bool take_all() {
    Sample sample;
    while (samples_.pop(sample)) {
      newest_s_ = sample.time_s;
      rows_.push_back(sample);
      if (rows_.size() == RecordingFile::kChunkRows && !write_rows()) return false;
    }
    Event event;
    while (events_.pop(event)) {
      event_rows_.push_back(event);
      if (event_rows_.size() == RecordingFile::kChunkRows && !write_events()) return false;
    }
    DatagramRow datagram;
    while (datagrams_.pop(datagram)) {
      datagram_rows_.push_back(datagram);
      if (datagram_rows_.size() == RecordingFile::kChunkRows && !write_datagrams()) return false;
    }
    StatePieceRow piece;
    while (state_pieces_.pop(piece)) {
      state_piece_rows_.push_back(piece);
      if (state_piece_rows_.size() == RecordingFile::kChunkRows && !write_state_pieces()) return false;
    }
    return true;
  }

  bool write_rows() {
    if (!file_.append(rows_)) return false;
    rows_.clear();
    return true;
  }

  bool write_events() {
    if (!file_.append(event_rows_)) return false;
    event_rows_.clear();
    return true;
  }

  bool write_datagrams() {
    if (!file_.append(datagram_rows_)) return false;
    datagram_rows_.clear();
    return true;
  }

  bool write_state_pieces() {
    if (!file_.append(state_piece_rows_)) return false;
    state_piece_rows_.clear();
    return true;
  }

  void take_marks() {
    if (!options_.newest_marks) return;
    const std::size_t had = mark_rows_.size();
    options_.newest_marks(mark_rows_);
    for (std::size_t i = had; i < mark_rows_.size(); ++i) mark_rows_[i].time_s = newest_s_;
  }

  bool write_marks() {
    for (std::span<const MarkRow> left(mark_rows_); !left.empty();) {
      const std::size_t count = std::min(left.size(), RecordingFile::kChunkRows);
      if (!file_.append(left.first(count))) return false;
      left = left.subspan(count);
    }
    mark_rows_.clear();
    return true;
  }

  bool write_all() {
    return write_rows() && write_events() && write_datagrams() && write_marks() && write_state_pieces();
  }

  void stop_recording() {
    {
      const std::lock_guard lock(failure_mutex_);
      failure_ = file_.error();
    }
    failed_.store(true, std::memory_order_release);
    file_.abandon();
    std::uint64_t lost = file_.rows() - rows_written_.load(std::memory_order_relaxed) + rows_.size();
    for (Sample sample; samples_.pop(sample);) ++lost;
    rows_lost_.store(lost, std::memory_order_relaxed);
    if (options_.on_failure) options_.on_failure(file_.error());
  }

  RecorderOptions options_;
  RecordingFile file_;
  rt::SpscQueue<Sample> samples_;
  rt::SpscQueue<Event> events_;
  rt::SpscQueue<DatagramRow> datagrams_;
  rt::SpscQueue<StatePieceRow> state_pieces_;
  std::uint64_t state_pieces_taken_ = 0;  // of the loop's thread
  std::vector<Sample> rows_;              // of the writer's thread, like event_rows_ and file_
  std::vector<Event> event_rows_;
  std::vector<DatagramRow> datagram_rows_;
  std::vector<MarkRow> mark_rows_;
  std::vector<StatePieceRow> state_piece_rows_;
  double newest_s_ = 0;  // time of the newest sample taken

  std::atomic<bool> stop_{false};
  std::atomic<bool> failed_{false};
  std::atomic<std::uint64_t> rows_written_{0};
  std::atomic<std::uint64_t> rows_dropped_{0};  // by the loop's thread
  std::atomic<std::uint64_t> rows_lost_{0};     // by the writer's thread, after a failure
  std::atomic<std::uint64_t> events_dropped_{0};
  std::atomic<std::uint64_t> datagrams_dropped_{0};
  std::atomic<std::uint64_t> state_pieces_dropped_{0};
  mutable std::mutex failure_mutex_;
  std::string failure_;
  std::thread thread_;
};

Recorder::Recorder(const RecorderOptions& options, const Configuration& configuration)
    : impl_(std::make_unique<Impl>(options, configuration)) {}
Recorder::~Recorder() = default;

bool Recorder::push(const Sample& sample) noexcept {
  return impl_->push(sample);
}
bool Recorder::push(const Event& event) noexcept {
  return impl_->push(event);
}
bool Recorder::push(const DatagramRow& row) noexcept {
  return impl_->push(row);
}
bool Recorder::push(const StatePieceRow& row) noexcept {
  return impl_->push(row);
}
void Recorder::close() {
  impl_->close();
}
bool Recorder::failed() const noexcept {
  return impl_->failed();
}
std::string Recorder::failure() const {
  return impl_->failure();
}
std::uint64_t Recorder::rows_written() const noexcept {
  return impl_->rows_written();
}
std::uint64_t Recorder::rows_dropped() const noexcept {
  return impl_->rows_dropped();
}
std::uint64_t Recorder::events_dropped() const noexcept {
  return impl_->events_dropped();
}

std::uint64_t Recorder::datagrams_dropped() const noexcept {
  return impl_->datagrams_dropped();
}
std::uint64_t Recorder::state_pieces_dropped() const noexcept {
  return impl_->state_pieces_dropped();
}

Event make_event(std::int64_t tick, double time_s, std::uint32_t code, const char* text,
                 std::uint32_t value) noexcept {
  Event event;
  event.tick = tick;
  event.time_s = time_s;
  event.code = code;
  event.value = value;
  std::memcpy(event.text.data(), text, std::min(std::strlen(text), event.text.size() - 1));
  return event;
}

}  // namespace telenano::recording
