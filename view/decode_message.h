// From bytes to a message.
#pragma once

#include <cstddef>
#include <cstdint>
#include <exception>

#include "view/live_state.h"

namespace waymark::view {

// Anybody can send on a channel, and anything may be in a file: the generated code throws on
// impossible lengths. What is no such message is counted.
template <typename Message>
void addDecoded(const void* data, std::size_t size, std::int64_t now_ns, LiveState* state) {
  Message message{};
  try {
    if (message.decode(data, 0, static_cast<int>(size)) < 0) return state->addMalformed();
  } catch (const std::exception&) {
    return state->addMalformed();
  }
  state->add(message, now_ns);
}

}  // namespace waymark::view
