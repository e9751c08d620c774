#include "telenano/common/link/codec.h"

#include "telenano/common/link/codec_messages.h"

namespace telenano::link {

Codec::Codec() : messages_(std::make_unique<Messages>()) {
  // The one field that lives on the heap: take its memory now; Clear() keeps it.
  messages_->welcome.set_scene_name(std::string(kSceneNameBytes, ' '));
  messages_->welcome.Clear();
}

Codec::~Codec() = default;

}  // namespace telenano::link
