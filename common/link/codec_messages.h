#pragma once

#include "proto/telenano.pb.h"
#include "proto/wire_messages.h"
#include "telenano/common/link/codec.h"

namespace telenano::link {

/// Protobuf's messages, made once and used again.
struct Codec::Messages {
  wire::Hello hello;
  wire::Challenge challenge;
  wire::Welcome welcome;
  wire::Refuse refuse;
  wire::Command command;
  wire::Reply reply;
  wire::Bye bye;
  wire::SceneRequest scene_request;
  wire::SceneChunk scene_chunk;
};

}  // namespace telenano::link
