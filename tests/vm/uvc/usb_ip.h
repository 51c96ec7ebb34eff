// The messages of USB/IP, protocol 1.1.1 (Documentation/usb/usbip_protocol.rst of the kernel), once
// a device has been imported: the host submits transfers and takes them back, the device answers.
// Tests only.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <variant>
#include <vector>

#include "base/result.h"
#include "tests/vm/uvc/bytes.h"

namespace waymark::testing::usb_ip {

inline constexpr std::size_t kHeaderBytes = 48;
inline constexpr std::size_t kIsoPacketBytes = 16;

// One packet of an isochronous transfer. The data of packets that were not filled are left out on
// the wire; `offset` still says where they belong in the host's buffer.
struct IsoPacket {
  std::uint32_t offset = 0;
  std::uint32_t length = 0;         // bytes the host has room for
  std::uint32_t actual_length = 0;  // bytes that came
  std::uint32_t status = 0;
  friend bool operator==(const IsoPacket&, const IsoPacket&) = default;
};

// A transfer the host asks for. What it sends, and the packets, follow the header.
struct Submit {
  std::uint32_t sequence = 0;
  bool in = false;  // from the device to the host
  std::uint32_t endpoint = 0;
  std::uint32_t length = 0;                // bytes to send, or room for what comes
  std::uint32_t packets = 0;               // of an isochronous transfer; else 0
  std::array<std::uint8_t, 8> setup = {};  // of a control transfer
};

// The host takes the transfer `target` back.
struct Unlink {
  std::uint32_t sequence = 0;
  std::uint32_t target = 0;
};

// What became of a transfer.
struct SubmitReply {
  std::uint32_t sequence = 0;
  std::int32_t status = 0;          // 0, or a negated errno
  std::uint32_t actual_length = 0;  // bytes that came, or were taken
  Bytes data;                       // what came, packet after packet without gaps; else empty
  std::vector<IsoPacket> packets;   // as many as were asked for
};

// What became of an unlink.
struct UnlinkReply {
  std::uint32_t sequence = 0;
  std::int32_t status = 0;  // -ECONNRESET where there was something to take back; else 0
};

// The device's side.
using Command = std::variant<Submit, Unlink>;
// Precondition: kHeaderBytes bytes.
[[nodiscard]] Result<Command> parseCommand(ByteView header);
// How many bytes follow the header of a submit: what is sent, then the packets.
[[nodiscard]] std::size_t sentBytes(const Submit& submit);
[[nodiscard]] std::size_t packetTableBytes(const Submit& submit);
[[nodiscard]] std::vector<IsoPacket> parsePackets(ByteView table);
[[nodiscard]] Bytes encode(const SubmitReply& reply);
[[nodiscard]] Bytes encode(const UnlinkReply& reply);

// The host's side, for tests that play it.
// `sent` is what goes out with it; `packets` are the isochronous ones.
[[nodiscard]] Bytes encode(const Submit& submit, ByteView sent,
                           const std::vector<IsoPacket>& packets);
[[nodiscard]] Bytes encode(const Unlink& unlink);
// A reply's header. The data (`actual_length` of them, for transfers to the host) and the packets
// (as many as were asked for) follow it.
using Reply = std::variant<SubmitReply, UnlinkReply>;
[[nodiscard]] Result<Reply> parseReply(ByteView header);

}  // namespace waymark::testing::usb_ip
