#include "tests/vm/uvc/uvc_session.h"

#include <algorithm>
#include <cerrno>
#include <utility>

#include <poll.h>
#include <sys/socket.h>

namespace waymark::testing {

using std::chrono::nanoseconds;

UvcSession::UvcSession(int socket, const CameraOptions& options, CameraDesk* desk)
    : socket_(socket),
      options_(options),
      desk_(desk),
      device_(options.identity, options.transfer) {}

void UvcSession::run() {
  bool alive = true;
  while (alive) {
    std::optional<Clock::time_point> deadline;
    if (stream_) deadline = frame_due_;
    bool readable = false;
    alive = waitUntilReadable(deadline, &readable) && (!readable || serveCommand());
    followStream();
    if (stream_ && Clock::now() >= frame_due_) startFrame();
    alive = alive && deliver();
  }
}

bool UvcSession::waitUntilReadable(std::optional<Clock::time_point> deadline, bool* readable) {
  pollfd entry{socket_, POLLIN, 0};
  timespec timeout{};
  if (deadline) {
    const nanoseconds left = std::max<nanoseconds>(*deadline - Clock::now(), nanoseconds(0));
    timeout.tv_sec = left.count() / 1'000'000'000;
    timeout.tv_nsec = left.count() % 1'000'000'000;
  }
  const int ready = ppoll(&entry, 1, deadline ? &timeout : nullptr, nullptr);
  *readable = ready > 0;
  return ready >= 0 || errno == EINTR;
}

bool UvcSession::serveCommand() {
  Bytes header;
  if (!receive(usb_ip::kHeaderBytes, &header)) return false;
  const Result<usb_ip::Command> command = usb_ip::parseCommand(header);
  if (!command) return false;
  if (const auto* unlinked = std::get_if<usb_ip::Unlink>(&*command)) return unlink(*unlinked);
  return submit(std::get<usb_ip::Submit>(*command));
}

bool UvcSession::submit(const usb_ip::Submit& submit) {
  Bytes sent;
  Bytes table;
  if (!receive(usb_ip::sentBytes(submit), &sent)) return false;
  if (!receive(usb_ip::packetTableBytes(submit), &table)) return false;
  if (submit.endpoint == 0) return control(submit, sent);
  if (submit.in && submit.endpoint == (kVideoEndpoint & 0x0f)) {
    transfers_.push_back({submit, usb_ip::parsePackets(table)});
    return true;
  }
  return send(usb_ip::encode(usb_ip::SubmitReply{submit.sequence, -EPIPE, 0, {}, {}}));
}

bool UvcSession::control(const usb_ip::Submit& submit, ByteView sent) {
  std::optional<Bytes> answer = device_.handle(parseSetupPacket(submit.setup), sent);
  {
    const std::lock_guard lock(desk_->mutex);
    desk_->state.controls = device_.controls();
  }
  usb_ip::SubmitReply reply{submit.sequence, -EPIPE, 0, {}, {}};
  if (answer) {
    reply.status = 0;
    reply.actual_length = submit.in ? static_cast<std::uint32_t>(answer->size()) : submit.length;
    reply.data = std::move(*answer);
  }
  return send(usb_ip::encode(reply));
}

bool UvcSession::unlink(const usb_ip::Unlink& unlink) {
  const auto removed = std::erase_if(transfers_, [&unlink](const Transfer& transfer) {
    return transfer.submit.sequence == unlink.target;
  });
  return send(usb_ip::encode(usb_ip::UnlinkReply{unlink.sequence, removed > 0 ? -ECONNRESET : 0}));
}

bool UvcSession::receive(std::size_t count, Bytes* bytes) const {
  bytes->resize(count);
  std::size_t have = 0;
  while (have < count) {
    const ssize_t got = recv(socket_, bytes->data() + have, count - have, MSG_WAITALL);
    if (got == 0 || (got < 0 && errno != EINTR)) return false;
    if (got > 0) have += static_cast<std::size_t>(got);
  }
  return true;
}

bool UvcSession::send(const Bytes& bytes) const {
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t put = ::send(socket_, bytes.data() + done, bytes.size() - done, MSG_NOSIGNAL);
    if (put < 0 && errno != EINTR) return false;
    if (put > 0) done += static_cast<std::size_t>(put);
  }
  return true;
}

// A stream that begins sends its first frame at once; of one that has ended, the rest is forgotten.
void UvcSession::followStream() {
  const std::optional<StreamMode> wanted = device_.stream();
  if (wanted == stream_) return;
  stream_ = wanted;
  payloads_.clear();
  frame_due_ = Clock::now();
  const std::lock_guard lock(desk_->mutex);
  desk_->state.stream = wanted;
}

void UvcSession::startFrame() {
  const nanoseconds interval(100LL * stream_->interval_100ns);
  // A thread that woke late catches up, but never by more than a frame.
  frame_due_ = std::max(frame_due_ + interval, Clock::now() - interval);
  Fault fault = Fault::kNone;
  std::uint64_t index = 0;
  {
    const std::lock_guard lock(desk_->mutex);
    if (Clock::now() < desk_->silent_until) return;
    if (!payloads_.empty()) {
      ++desk_->state.skipped;
      return;
    }
    index = desk_->state.asked++;
    if (desk_->faulty_frames > 0) {
      --desk_->faulty_frames;
      fault = desk_->fault;
    }
  }
  const Bytes frame = damaged(options_.frames(*stream_, index), fault);
  frame_id_ = !frame_id_;
  frame_damaged_ = fault != Fault::kNone;
  for (Bytes& payload :
       cutIntoPayloads(frame, stream_->max_payload_bytes, frame_id_, fault == Fault::kErrorBit)) {
    payloads_.push_back(std::move(payload));
  }
}

bool UvcSession::deliver() {
  while (!payloads_.empty() && !transfers_.empty()) {
    const usb_ip::SubmitReply reply = fill(transfers_.front());
    transfers_.pop_front();
    if (!send(usb_ip::encode(reply))) return false;
    if (payloads_.empty()) {
      const std::lock_guard lock(desk_->mutex);
      ++desk_->state.sent;
      if (frame_damaged_) ++desk_->state.damaged;
    }
  }
  return true;
}

// Takes one payload for a bulk transfer; for an isochronous one as many as it has packets, or fewer
// at the end of a frame: the host does not wait there for the next frame.
usb_ip::SubmitReply UvcSession::fill(const Transfer& transfer) {
  usb_ip::SubmitReply reply;
  reply.sequence = transfer.submit.sequence;
  const auto take = [this, &reply](std::uint32_t room) {
    if (payloads_.empty()) return std::uint32_t{0};
    const Bytes& payload = payloads_.front();
    const auto count = std::min(room, static_cast<std::uint32_t>(payload.size()));
    reply.data.insert(reply.data.end(), payload.begin(), payload.begin() + count);
    reply.actual_length += count;
    payloads_.pop_front();
    return count;
  };
  if (transfer.packets.empty()) take(transfer.submit.length);
  reply.packets = transfer.packets;
  for (usb_ip::IsoPacket& packet : reply.packets) {
    packet.actual_length = take(packet.length);
    packet.status = 0;
  }
  return reply;
}

}  // namespace waymark::testing
