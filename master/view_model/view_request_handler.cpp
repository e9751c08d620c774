#include "telenano/master/view_model/view_request_handler.h"

namespace telenano::view_model {

bool ViewRequestHandler::safe(control::Method method, const control::Scaling& scaling,
                              const station::Station& station) const noexcept {
  return station.config().allow_unsafe_scaling ||
         scaling.impedance() <= impedance_bound_[static_cast<std::size_t>(method)];
}

ViewRequestHandler::Asked ViewRequestHandler::answer(station::Station& station) noexcept {
  Asked asked;
  port_.buttons.try_load(asked.buttons);
  ViewRequest request;
  // The queue is short; a screen that goes on filling it must not keep the loop here.
  for (std::size_t i = 0; i < port_.requests.capacity() && port_.requests.pop(request); ++i) {
    switch (request.kind) {
      case ViewRequest::Kind::kClearStop:
        station.clear_stop();
        break;
      case ViewRequest::Kind::kMethod:
        if (safe(request.method, station.config().scaling, station)) {
          station.change_method(request.method);
        } else {
          ++refused_;
        }
        break;
      case ViewRequest::Kind::kScaling:
        if (!safe(station.method(), request.scaling, station) || !station.change_scaling(request.scaling))
          ++refused_;
        break;
      case ViewRequest::Kind::kMarker:
        ++asked.marks;
        break;
      case ViewRequest::Kind::kTask:
        asked.task = request.task;
        break;
      case ViewRequest::Kind::kScene:
        asked.scene = request.scene;
        break;
      case ViewRequest::Kind::kPractice:
        asked.practice = request.practice;
        break;
      case ViewRequest::Kind::kUndo:
        asked.undo = true;
        break;
    }
  }
  // After what was asked before it: a stop that was cleared in the same tick stays.
  if (const std::uint32_t stops = port_.stops.load(std::memory_order_relaxed); stops != stops_) {
    stops_ = stops;
    asked.buttons |= device::kButtonStop;
  }
  asked.quit = port_.quit.load(std::memory_order_relaxed);
  return asked;
}

void ViewRequestHandler::show(const recording::Sample& sample, device::ForceOffCause force_off) noexcept {
  port_.samples.push(sample);
  port_.force_off.store(force_off);
}

}  // namespace telenano::view_model
