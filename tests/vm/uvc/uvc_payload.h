// A frame as it travels: cut into payloads, each behind a header, UVC 1.1, section 2.4.3. Also the
// ways in which it may come to harm. Tests only.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "tests/vm/uvc/bytes.h"

namespace waymark::testing {

inline constexpr std::size_t kPayloadHeaderBytes = 2;

enum class Fault {
  kNone,
  kShort,     // its second half never comes
  kGarbled,   // a stretch in the middle is other bytes; as many as there should be
  kErrorBit,  // all there, but the camera itself says that something is wrong with it
};

// What is left of a frame's bytes. kErrorBit leaves them alone.
[[nodiscard]] Bytes damaged(Bytes frame, Fault fault);

// Payloads of at most `max_payload_bytes` with their headers; the last one is marked as the end of
// the frame. `frame_id` alternates from frame to frame; `error` marks every payload as faulty.
// Precondition: max_payload_bytes > kPayloadHeaderBytes.
[[nodiscard]] std::vector<Bytes> cutIntoPayloads(ByteView frame, std::size_t max_payload_bytes,
                                                 bool frame_id, bool error);

}  // namespace waymark::testing
