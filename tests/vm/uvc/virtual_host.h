// A host at the other end of the test camera's socket: what vhci-hcd and uvcvideo do with a camera,
// as far as the camera can tell. Host tests only.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include "base/unique_fd.h"
#include "tests/vm/uvc/bytes.h"
#include "tests/vm/uvc/usb_ip.h"
#include "tests/vm/uvc/uvc_device.h"

namespace waymark::testing {

struct ReceivedFrame {
  Bytes bytes;
  bool frame_id = false;
  bool error = false;
};

// Every call waits for its answer, and throws std::runtime_error when the camera has gone.
class VirtualHost {
 public:
  VirtualHost(UniqueFd socket, Transfer transfer);

  // Empty when the camera stalls.
  [[nodiscard]] std::optional<Bytes> control(const SetupPacket& setup, ByteView sent = {});

  // Configures the camera, commits the mode, and asks for video.
  void startStream(std::uint8_t format_index, std::uint8_t frame_index,
                   std::uint32_t interval_100ns);
  // Takes back every transfer, then says that it is over. How many were taken back.
  int stopStream();

  [[nodiscard]] ReceivedFrame receiveFrame();

 private:
  static constexpr int kTransfers = 5;  // at the same time, as uvcvideo has them

  void submitVideo();
  // The next reply to a transfer of video.
  [[nodiscard]] usb_ip::SubmitReply receiveVideo();
  // False at the end of a frame.
  [[nodiscard]] bool append(ByteView payload, ReceivedFrame* frame);
  [[nodiscard]] usb_ip::Reply receiveReply();
  void receive(std::size_t count, Bytes* bytes);
  void send(const Bytes& bytes);

  const UniqueFd socket_;
  const Transfer transfer_;
  std::uint32_t sequence_ = 0;
  bool control_in_ = false;                // the control transfer under way brings bytes
  std::deque<std::uint32_t> waiting_;      // sequence numbers of the transfers under way
  std::deque<usb_ip::SubmitReply> video_;  // came while something else was waited for
};

}  // namespace waymark::testing
