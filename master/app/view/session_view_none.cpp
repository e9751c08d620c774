// In a build without viewer: the same flags, and what to do about it.
#include "telenano/common/base/error.h"
#include "telenano/master/app/view/recorded_view.h"
#include "telenano/master/app/view/session_view.h"

namespace telenano::app {

struct SessionView::Parts {};

namespace {

[[noreturn]] void refuse() {
  throw UserError(
      "this build has no viewer: install libglfw3-dev libimgui-dev libepoxy-dev libgl-dev libegl-dev and "
      "configure with -DTELENANO_VIEWER=ON; --device sim needs none");
}

}  // namespace

std::string view_recording(const std::string&, const ViewOptions&) {
  refuse();
}

SessionView::SessionView(const ViewOptions& options, bool mouse) : options_(options) {
  if (options.view || options.guide || mouse || !options.screenshot.empty()) refuse();
}

SessionView::~SessionView() = default;

void SessionView::wait_for(const Waiting&, const std::function<void()>& work) {
  work();
}

view_model::ViewRequestHandler* SessionView::begin(const ViewedSession&) {
  return nullptr;
}

std::string SessionView::run(const RealTimeSession&, bool, const Callbacks&) {
  return "";
}

}  // namespace telenano::app
