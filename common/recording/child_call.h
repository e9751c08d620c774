#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <string_view>

namespace telenano::recording {

/// What a process of its own may take, and the words for its end.
struct ChildLimits {
  std::chrono::seconds time{300};  ///< of the processor, for all answers; and the wait for each of them
  std::size_t memory_bytes = 0;    ///< beyond what it begins with; it then opens and writes no files. 0: any
  std::size_t answer_bytes = SIZE_MAX;
  std::string reader = "the HDF5 library";
  std::string advice = "take another copy of the file";
};

/// A function in a process of its own. What a library does to itself over a damaged or hostile file (a crash,
/// a loop without end) happens there: here it becomes one clear error.
///
/// The process is made by fork(), so construct it while no other thread of this program works with what
/// `serve` uses. It ends with the object, and with this program.
class ChildCall {
 public:
  using Serve = std::function<std::string(std::string_view request)>;
  /// Asked several times a second while an answer is waited for. False: nobody wants it, and the process is ended.
  using StillWanted = std::function<bool()>;

  /// `subject` begins every error (a file's name). `time_limit` is for the processor's time of the whole
  /// process, and for the wait for each answer.
  ChildCall(std::string subject, const Serve& serve,
            std::chrono::seconds time_limit = std::chrono::seconds(300));
  ChildCall(std::string subject, const Serve& serve, const ChildLimits& limits);
  ~ChildCall();
  ChildCall(const ChildCall&) = delete;
  ChildCall& operator=(const ChildCall&) = delete;

  /// What serve(request) gives there. Throws the UserError or RunError that it throws; RunError for any other
  /// exception, and when the process comes to its end. With `still_wanted` that says how long the answer is waited
  /// for, and of the limit on time only the processor's is left.
  std::string ask(std::string_view request, const StillWanted& still_wanted = nullptr);

  /// From any thread: the process ends at once. An ask() under way ends by a RunError, as every later one.
  void stop() noexcept;
  /// From any thread: from now on the process gives way to all others (nice 19).
  void give_way() noexcept;
  /// It has come to its end: no further question is answered.
  bool is_over() noexcept;

 private:
  void await_answer(const StillWanted& still_wanted);
  [[noreturn]] void ended();

  std::string subject_;
  ChildLimits limits_;
  std::mutex reaping_;  // a process is killed before it is waited for, or not at all: its number may be
                        // another's then
  pid_t pid_ = -1;
  int fd_ = -1;
};

}  // namespace telenano::recording
