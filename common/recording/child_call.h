#pragma once

#include <sys/types.h>

#include <chrono>
#include <functional>
#include <string>
#include <string_view>

namespace telenano::recording {

/// A function in a process of its own. What a library does to itself over a damaged or hostile file (a crash,
/// a loop without end) happens there: here it becomes one clear error.
///
/// The process is made by fork(), so construct it while no other thread of this program works with what
/// `serve` uses. It ends with the object, and with this program.
class ChildCall {
 public:
  using Serve = std::function<std::string(std::string_view request)>;

  /// `subject` begins every error (a file's name). `time_limit` is for the processor's time of the whole
  /// process, and for the wait for each answer.
  ChildCall(std::string subject, const Serve& serve,
            std::chrono::seconds time_limit = std::chrono::seconds(300));
  ~ChildCall();
  ChildCall(const ChildCall&) = delete;
  ChildCall& operator=(const ChildCall&) = delete;

  /// What serve(request) gives there. Throws the UserError or RunError that it throws; RunError for any other
  /// exception, and when the process comes to its end.
  std::string ask(std::string_view request);

 private:
  [[noreturn]] void ended();

  std::string subject_;
  pid_t pid_ = -1;
  int fd_ = -1;
};

}  // namespace telenano::recording
