#include "tests/vm/uvc/virtual_host.h"

#include <algorithm>
#include <cerrno>
#include <stdexcept>
#include <utility>

#include <linux/usb/ch9.h>
#include <linux/usb/video.h>
#include <sys/socket.h>

#include "tests/vm/uvc/uvc_payload.h"

namespace waymark::testing {
namespace {

constexpr std::uint32_t kIsoPackets = 4;
constexpr std::uint32_t kIsoPacketRoom = 3072;
constexpr std::uint32_t kBulkRoom = 16384;

usb_ip::Submit controlSubmit(std::uint32_t sequence, const SetupPacket& setup) {
  usb_ip::Submit submit;
  submit.sequence = sequence;
  submit.in = (setup.request_type & USB_DIR_IN) != 0;
  submit.length = setup.length;
  const Bytes bytes = ByteWriter()
                          .u8(setup.request_type)
                          .u8(setup.request)
                          .le16(setup.value)
                          .le16(setup.index)
                          .le16(setup.length)
                          .take();
  std::ranges::copy(bytes, submit.setup.begin());
  return submit;
}

}  // namespace

VirtualHost::VirtualHost(UniqueFd socket, Transfer transfer)
    : socket_(std::move(socket)), transfer_(transfer) {}

std::optional<Bytes> VirtualHost::control(const SetupPacket& setup, ByteView sent) {
  const usb_ip::Submit submit = controlSubmit(++sequence_, setup);
  control_in_ = submit.in;
  send(usb_ip::encode(submit, sent, {}));
  while (true) {
    auto reply = std::get<usb_ip::SubmitReply>(receiveReply());
    if (reply.sequence != submit.sequence) {
      video_.push_back(std::move(reply));
      continue;
    }
    if (reply.status != 0) return std::nullopt;
    return reply.data;
  }
}

void VirtualHost::startStream(std::uint8_t format_index, std::uint8_t frame_index,
                              std::uint32_t interval_100ns) {
  (void)control({0, USB_REQ_SET_CONFIGURATION, kConfiguration, 0, 0});
  ByteWriter writer;
  writer.le16(1).u8(format_index).u8(frame_index).le32(interval_100ns);
  const Bytes proposal = writer.zeros(34 - writer.size()).take();
  (void)control({USB_TYPE_CLASS | USB_RECIP_INTERFACE, UVC_SET_CUR, UVC_VS_COMMIT_CONTROL << 8,
                 kStreamingInterface, static_cast<std::uint16_t>(proposal.size())},
                proposal);
  if (transfer_ == Transfer::kIsochronous) {
    (void)control({USB_RECIP_INTERFACE, USB_REQ_SET_INTERFACE, 1, kStreamingInterface, 0});
  }
  for (int i = 0; i < kTransfers; ++i) submitVideo();
}

int VirtualHost::stopStream() {
  int taken_back = 0;
  while (!waiting_.empty()) {
    const std::uint32_t unlink = ++sequence_;
    send(usb_ip::encode(usb_ip::Unlink{unlink, waiting_.front()}));
    while (true) {
      const usb_ip::Reply reply = receiveReply();
      const auto* unlinked = std::get_if<usb_ip::UnlinkReply>(&reply);
      if (unlinked == nullptr) continue;  // video that was on its way
      if (unlinked->status == -ECONNRESET) ++taken_back;
      break;
    }
    if (!waiting_.empty()) waiting_.pop_front();
  }
  if (transfer_ == Transfer::kIsochronous) {
    (void)control({USB_RECIP_INTERFACE, USB_REQ_SET_INTERFACE, 0, kStreamingInterface, 0});
  } else {
    (void)control({USB_RECIP_ENDPOINT, USB_REQ_CLEAR_FEATURE, 0, kVideoEndpoint, 0});
  }
  return taken_back;
}

ReceivedFrame VirtualHost::receiveFrame() {
  ReceivedFrame frame;
  bool more = true;
  while (more) {
    const usb_ip::SubmitReply reply = receiveVideo();
    std::size_t at = 0;
    if (reply.packets.empty()) more = append(reply.data, &frame);
    for (const usb_ip::IsoPacket& packet : reply.packets) {
      more = more && append(ByteView(reply.data).subspan(at, packet.actual_length), &frame);
      at += packet.actual_length;
    }
    submitVideo();
  }
  return frame;
}

bool VirtualHost::append(ByteView payload, ReceivedFrame* frame) {
  if (payload.size() <= kPayloadHeaderBytes) return true;
  const unsigned flags = payload[1];
  frame->frame_id = (flags & UVC_STREAM_FID) != 0;
  frame->error = frame->error || (flags & UVC_STREAM_ERR) != 0;
  frame->bytes.insert(frame->bytes.end(), payload.begin() + kPayloadHeaderBytes, payload.end());
  return (flags & UVC_STREAM_EOF) == 0;
}

void VirtualHost::submitVideo() {
  usb_ip::Submit submit;
  submit.sequence = ++sequence_;
  submit.in = true;
  submit.endpoint = kVideoEndpoint & 0x0f;
  submit.length = kBulkRoom;
  std::vector<usb_ip::IsoPacket> packets;
  if (transfer_ == Transfer::kIsochronous) {
    for (std::uint32_t i = 0; i < kIsoPackets; ++i) {
      packets.push_back({i * kIsoPacketRoom, kIsoPacketRoom, 0, 0});
    }
    submit.length = kIsoPackets * kIsoPacketRoom;
  }
  send(usb_ip::encode(submit, {}, packets));
  waiting_.push_back(submit.sequence);
}

usb_ip::SubmitReply VirtualHost::receiveVideo() {
  if (video_.empty()) return std::get<usb_ip::SubmitReply>(receiveReply());
  usb_ip::SubmitReply reply = std::move(video_.front());
  video_.pop_front();
  return reply;
}

usb_ip::Reply VirtualHost::receiveReply() {
  Bytes header;
  receive(usb_ip::kHeaderBytes, &header);
  const Result<usb_ip::Reply> parsed = usb_ip::parseReply(header);
  if (!parsed) throw std::runtime_error(parsed.error().message);
  usb_ip::Reply message = *parsed;
  auto* reply = std::get_if<usb_ip::SubmitReply>(&message);
  if (reply == nullptr) return message;
  const bool video = std::ranges::find(waiting_, reply->sequence) != waiting_.end();
  std::erase(waiting_, reply->sequence);
  if (video || control_in_) receive(reply->actual_length, &reply->data);
  if (video && transfer_ == Transfer::kIsochronous) {
    Bytes table;
    receive(kIsoPackets * usb_ip::kIsoPacketBytes, &table);
    reply->packets = usb_ip::parsePackets(table);
  }
  return message;
}

void VirtualHost::receive(std::size_t count, Bytes* bytes) {
  bytes->resize(count);
  if (count == 0) return;
  const ssize_t got = recv(socket_.get(), bytes->data(), count, MSG_WAITALL);
  if (got != static_cast<ssize_t>(count)) throw std::runtime_error("the camera has gone");
}

void VirtualHost::send(const Bytes& bytes) {
  const ssize_t put = ::send(socket_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
  if (put != static_cast<ssize_t>(bytes.size())) throw std::runtime_error("the camera has gone");
}

}  // namespace waymark::testing
