// The test camera's mind: what it answers on endpoint 0, and which stream the host has asked for.
// No thread, no socket: one request in, one answer out. Tests only.
#pragma once

#include <cstdint>
#include <optional>

#include "tests/vm/uvc/bytes.h"
#include "tests/vm/uvc/uvc_controls.h"
#include "tests/vm/uvc/uvc_descriptors.h"

namespace waymark::testing {

// The setup packet of a control transfer, named as in USB 2.0, section 9.3.
struct SetupPacket {
  std::uint8_t request_type = 0;
  std::uint8_t request = 0;
  std::uint16_t value = 0;
  std::uint16_t index = 0;
  std::uint16_t length = 0;
};
// Precondition: eight bytes.
[[nodiscard]] SetupPacket parseSetupPacket(ByteView bytes);

// As a camera that has just been given power. `sent` is what came along with a request; the answer
// is what goes back, not longer than was asked for; empty for a stall, which is how devices reject.
class UvcDevice {
 public:
  UvcDevice(CameraIdentity identity, Transfer transfer);

  [[nodiscard]] std::optional<Bytes> handle(const SetupPacket& setup, ByteView sent);

  // What the host wants to receive just now; empty when nothing.
  [[nodiscard]] std::optional<StreamMode> stream() const;

  [[nodiscard]] const UvcControls& controls() const { return controls_; }

 private:
  // What the probe control holds: the host proposes, the camera answers with what it can do.
  struct Proposal {
    std::uint8_t format_index = 1;
    std::uint8_t frame_index = 1;
    StreamMode mode;
  };

  [[nodiscard]] std::optional<Bytes> standardRequest(const SetupPacket& setup);
  [[nodiscard]] std::optional<Bytes> descriptor(const SetupPacket& setup) const;
  [[nodiscard]] std::optional<Bytes> setInterface(const SetupPacket& setup);
  [[nodiscard]] std::optional<Bytes> clearFeature(const SetupPacket& setup);
  [[nodiscard]] std::optional<Bytes> classRequest(const SetupPacket& setup, ByteView sent);
  [[nodiscard]] std::optional<Bytes> streamRequest(const SetupPacket& setup, ByteView sent);
  [[nodiscard]] std::optional<Bytes> setProposal(std::uint8_t selector, ByteView sent);

  const CameraIdentity identity_;
  const Transfer transfer_;
  UvcControls controls_;
  std::uint8_t configuration_ = 0;
  std::uint8_t alternate_ = 0;  // of the streaming interface
  Proposal probe_;
  std::optional<Proposal> commit_;
};

}  // namespace waymark::testing
