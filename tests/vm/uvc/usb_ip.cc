#include "tests/vm/uvc/usb_ip.h"

#include <algorithm>
#include <string>

namespace waymark::testing::usb_ip {
namespace {

constexpr std::uint32_t kSubmit = 1;
constexpr std::uint32_t kUnlink = 2;
constexpr std::uint32_t kSubmitReply = 3;
constexpr std::uint32_t kUnlinkReply = 4;

// Where the fields are in a header.
constexpr std::size_t kCommandAt = 0;
constexpr std::size_t kSequenceAt = 4;
constexpr std::size_t kDirectionAt = 12;
constexpr std::size_t kEndpointAt = 16;
constexpr std::size_t kFirstFieldAt = 20;  // flags, status or the target of an unlink
constexpr std::size_t kLengthAt = 24;
constexpr std::size_t kPacketsAt = 32;
constexpr std::size_t kSetupAt = 40;

// Command, sequence, device id, direction and endpoint begin every message. The kernel's host knows
// its device by the socket and looks at neither of the last three in replies.
ByteWriter beginMessage(std::uint32_t command, std::uint32_t sequence, bool in,
                        std::uint32_t endpoint) {
  ByteWriter writer;
  writer.be32(command).be32(sequence).be32(0).be32(in ? 1 : 0).be32(endpoint);
  return writer;
}

void appendPackets(const std::vector<IsoPacket>& packets, ByteWriter* writer) {
  for (const IsoPacket& packet : packets) {
    writer->be32(packet.offset).be32(packet.length).be32(packet.actual_length).be32(packet.status);
  }
}

Submit parseSubmit(ByteView header) {
  Submit submit;
  submit.sequence = readBe32(header, kSequenceAt);
  submit.in = readBe32(header, kDirectionAt) == 1;
  submit.endpoint = readBe32(header, kEndpointAt);
  submit.length = readBe32(header, kLengthAt);
  // Some kernels say "not isochronous" with 0, some with -1.
  const auto packets = static_cast<std::int32_t>(readBe32(header, kPacketsAt));
  submit.packets = static_cast<std::uint32_t>(std::max(packets, 0));
  std::copy_n(header.begin() + kSetupAt, submit.setup.size(), submit.setup.begin());
  return submit;
}

Error unknownMessage(ByteView header) {
  return Error{"USB/IP: message of unknown kind " + std::to_string(readBe32(header, kCommandAt))};
}

}  // namespace

Result<Command> parseCommand(ByteView header) {
  switch (readBe32(header, kCommandAt)) {
    case kSubmit:
      return Command(parseSubmit(header));
    case kUnlink:
      return Command(Unlink{readBe32(header, kSequenceAt), readBe32(header, kFirstFieldAt)});
    default:
      return unknownMessage(header);
  }
}

std::size_t sentBytes(const Submit& submit) { return submit.in ? 0 : submit.length; }

std::size_t packetTableBytes(const Submit& submit) { return submit.packets * kIsoPacketBytes; }

std::vector<IsoPacket> parsePackets(ByteView table) {
  std::vector<IsoPacket> packets;
  for (std::size_t at = 0; at + kIsoPacketBytes <= table.size(); at += kIsoPacketBytes) {
    packets.push_back({readBe32(table, at), readBe32(table, at + 4), readBe32(table, at + 8),
                       readBe32(table, at + 12)});
  }
  return packets;
}

Bytes encode(const SubmitReply& reply) {
  ByteWriter writer = beginMessage(kSubmitReply, reply.sequence, false, 0);
  writer.be32(static_cast<std::uint32_t>(reply.status)).be32(reply.actual_length);
  writer.be32(0);  // start frame
  writer.be32(static_cast<std::uint32_t>(reply.packets.size()));
  writer.be32(0);  // error count
  writer.zeros(kHeaderBytes - writer.size());
  writer.append(reply.data);
  appendPackets(reply.packets, &writer);
  return writer.take();
}

Bytes encode(const UnlinkReply& reply) {
  ByteWriter writer = beginMessage(kUnlinkReply, reply.sequence, false, 0);
  writer.be32(static_cast<std::uint32_t>(reply.status));
  writer.zeros(kHeaderBytes - writer.size());
  return writer.take();
}

Bytes encode(const Submit& submit, ByteView sent, const std::vector<IsoPacket>& packets) {
  ByteWriter writer = beginMessage(kSubmit, submit.sequence, submit.in, submit.endpoint);
  writer.be32(0).be32(submit.length).be32(0);  // flags, length, start frame
  writer.be32(static_cast<std::uint32_t>(packets.size()));
  writer.be32(0);  // interval
  writer.append(submit.setup);
  writer.append(sent);
  appendPackets(packets, &writer);
  return writer.take();
}

Bytes encode(const Unlink& unlink) {
  ByteWriter writer = beginMessage(kUnlink, unlink.sequence, false, 0);
  writer.be32(unlink.target);
  writer.zeros(kHeaderBytes - writer.size());
  return writer.take();
}

Result<Reply> parseReply(ByteView header) {
  const std::uint32_t sequence = readBe32(header, kSequenceAt);
  const auto status = static_cast<std::int32_t>(readBe32(header, kFirstFieldAt));
  switch (readBe32(header, kCommandAt)) {
    case kSubmitReply:
      return Reply(SubmitReply{sequence, status, readBe32(header, kLengthAt), {}, {}});
    case kUnlinkReply:
      return Reply(UnlinkReply{sequence, status});
    default:
      return unknownMessage(header);
  }
}

}  // namespace waymark::testing::usb_ip
