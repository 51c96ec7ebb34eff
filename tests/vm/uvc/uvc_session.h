// One stay of the test camera at a host, from plugging in to unplugging: USB/IP on one side, the
// device's mind and the frames on the other. Tests only.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <vector>

#include "tests/vm/uvc/bytes.h"
#include "tests/vm/uvc/usb_ip.h"
#include "tests/vm/uvc/uvc_device.h"
#include "tests/vm/uvc/uvc_payload.h"

namespace waymark::testing {

// The next frame's bytes, asked for when it is due, in the camera's thread. `index` counts the
// frames asked for since the camera was made. An empty answer: nothing this time.
using FrameSupplier = std::function<Bytes(const StreamMode& mode, std::uint64_t index)>;

struct CameraOptions {
  CameraIdentity identity;
  Transfer transfer = Transfer::kIsochronous;
  FrameSupplier frames;
};

struct CameraState {
  bool connected = false;
  std::optional<StreamMode> stream;  // what the host is receiving
  UvcControls controls;              // as the host has set them
  // Since the camera was made:
  std::uint64_t asked = 0;    // of the supplier
  std::uint64_t sent = 0;     // to the host's last byte, damaged ones included
  std::uint64_t damaged = 0;  // of those sent
  std::uint64_t skipped = 0;  // due while the host had not yet fetched the one before
};

// What the camera's owner and its thread share.
struct CameraDesk {
  mutable std::mutex mutex;
  CameraState state;
  Fault fault = Fault::kNone;
  int faulty_frames = 0;  // the next ones are damaged
  std::chrono::steady_clock::time_point silent_until;
};

class UvcSession {
 public:
  // `socket` is connected to the host. All arguments must outlive the session.
  UvcSession(int socket, const CameraOptions& options, CameraDesk* desk);

  // Until the connection ends, or the host says something that is not USB/IP.
  void run();

 private:
  using Clock = std::chrono::steady_clock;

  struct Transfer {
    usb_ip::Submit submit;
    std::vector<usb_ip::IsoPacket> packets;  // empty: a bulk transfer
  };

  // False when the connection is over.
  [[nodiscard]] bool waitUntilReadable(std::optional<Clock::time_point> deadline, bool* readable);
  [[nodiscard]] bool serveCommand();
  [[nodiscard]] bool submit(const usb_ip::Submit& submit);
  [[nodiscard]] bool control(const usb_ip::Submit& submit, ByteView sent);
  [[nodiscard]] bool unlink(const usb_ip::Unlink& unlink);
  [[nodiscard]] bool receive(std::size_t count, Bytes* bytes) const;
  [[nodiscard]] bool send(const Bytes& bytes) const;

  void followStream();
  void startFrame();
  [[nodiscard]] bool deliver();
  [[nodiscard]] usb_ip::SubmitReply fill(const Transfer& transfer);

  const int socket_;
  const CameraOptions& options_;
  CameraDesk* const desk_;
  UvcDevice device_;
  std::optional<StreamMode> stream_;
  Clock::time_point frame_due_;
  std::deque<Transfer> transfers_;  // where the host waits for video
  std::deque<Bytes> payloads_;      // of the frame under way
  bool frame_id_ = false;
  bool frame_damaged_ = false;
};

}  // namespace waymark::testing
