#include "telenano/nve_server/server/worker_mail.h"

namespace telenano::server {

WorkerMail::WorkerMail(std::size_t workers) : workers_(workers) {
  for (std::size_t i = 0; i < workers_ * workers_; ++i) {
    queues_.push_back(std::make_unique<rt::SpscQueue<HandoffMessage>>(2 * kOpenQuestions));
  }
}

WorkerMail::~WorkerMail() {
  HandoffMessage message;
  for (std::size_t to = 0; to < workers_; ++to) {
    while (fetch(to, message)) delete message.state;
  }
}

bool WorkerMail::fetch(std::size_t to, HandoffMessage& message) noexcept {
  for (std::size_t from = 0; from < workers_; ++from) {
    if (from != to && queue(from, to).pop(message)) return true;
  }
  return false;
}

}  // namespace telenano::server
