#include "tests/vm/uvc/uvc_device.h"

#include <algorithm>
#include <utility>

#include <linux/usb/ch9.h>
#include <linux/usb/video.h>

namespace waymark::testing {
namespace {

constexpr std::size_t kProposalBytes = 34;     // of UVC 1.1
constexpr std::size_t kOldProposalBytes = 26;  // of UVC 1.0, which is how the newer one begins

std::uint8_t highByte(std::uint16_t value) { return static_cast<std::uint8_t>(value >> 8); }
std::uint8_t lowByte(std::uint16_t value) { return static_cast<std::uint8_t>(value & 0xff); }

}  // namespace

SetupPacket parseSetupPacket(ByteView bytes) {
  return {bytes[0], bytes[1], readLe16(bytes, 2), readLe16(bytes, 4), readLe16(bytes, 6)};
}

UvcDevice::UvcDevice(CameraIdentity identity, Transfer transfer)
    : identity_(std::move(identity)), transfer_(transfer) {
  probe_.mode =
      *modeOf(1, 1, offeredFormats().front().sizes.front().intervals_100ns.front(), transfer_);
}

std::optional<Bytes> UvcDevice::handle(const SetupPacket& setup, ByteView sent) {
  std::optional<Bytes> answer;
  switch (setup.request_type & USB_TYPE_MASK) {
    case USB_TYPE_STANDARD:
      answer = standardRequest(setup);
      break;
    case USB_TYPE_CLASS:
      answer = classRequest(setup, sent);
      break;
    default:
      break;
  }
  if (answer && answer->size() > setup.length) answer->resize(setup.length);
  return answer;
}

std::optional<StreamMode> UvcDevice::stream() const {
  if (!commit_ || configuration_ == 0) return std::nullopt;
  if (transfer_ == Transfer::kIsochronous && alternate_ == 0) return std::nullopt;
  return commit_->mode;
}

std::optional<Bytes> UvcDevice::standardRequest(const SetupPacket& setup) {
  switch (setup.request) {
    case USB_REQ_GET_STATUS:
      return Bytes{0, 0};  // powered by the bus, nothing halted
    case USB_REQ_GET_DESCRIPTOR:
      return descriptor(setup);
    case USB_REQ_GET_CONFIGURATION:
      return Bytes{configuration_};
    case USB_REQ_SET_CONFIGURATION:
      if (setup.value > kConfiguration) return std::nullopt;
      configuration_ = lowByte(setup.value);
      alternate_ = 0;
      commit_.reset();
      return Bytes{};
    case USB_REQ_GET_INTERFACE:
      return Bytes{setup.index == kStreamingInterface ? alternate_ : std::uint8_t{0}};
    case USB_REQ_SET_INTERFACE:
      return setInterface(setup);
    case USB_REQ_CLEAR_FEATURE:
      return clearFeature(setup);
    default:
      return std::nullopt;
  }
}

std::optional<Bytes> UvcDevice::descriptor(const SetupPacket& setup) const {
  switch (highByte(setup.value)) {
    case USB_DT_DEVICE:
      return deviceDescriptor(identity_);
    case USB_DT_CONFIG:
      return configurationDescriptor(transfer_);
    case USB_DT_STRING:
      return stringDescriptor(identity_, lowByte(setup.value));
    default:
      return std::nullopt;
  }
}

// Isochronous streams begin and end with their interface's setting.
std::optional<Bytes> UvcDevice::setInterface(const SetupPacket& setup) {
  const bool streaming = setup.index == kStreamingInterface;
  const int highest = streaming && transfer_ == Transfer::kIsochronous ? 1 : 0;
  if (setup.index > kStreamingInterface || setup.value > highest) return std::nullopt;
  if (streaming) alternate_ = lowByte(setup.value);
  if (streaming && alternate_ == 0) commit_.reset();
  return Bytes{};
}

// UVC has no word for the end of a bulk stream; hosts say it with this request.
std::optional<Bytes> UvcDevice::clearFeature(const SetupPacket& setup) {
  const bool endpoint = (setup.request_type & USB_RECIP_MASK) == USB_RECIP_ENDPOINT;
  if (endpoint && lowByte(setup.index) == kVideoEndpoint) commit_.reset();
  return Bytes{};
}

std::optional<Bytes> UvcDevice::classRequest(const SetupPacket& setup, ByteView sent) {
  if ((setup.request_type & USB_RECIP_MASK) != USB_RECIP_INTERFACE) return std::nullopt;
  const std::uint8_t unit = highByte(setup.index);
  const std::uint8_t selector = highByte(setup.value);
  switch (lowByte(setup.index)) {
    case kControlInterface:
      // The interface itself, unit 0, has but one control.
      if (unit == 0 && selector == UVC_VC_REQUEST_ERROR_CODE_CONTROL &&
          setup.request == UVC_GET_CUR) {
        return Bytes{static_cast<std::uint8_t>(controls_.lastError())};
      }
      return controls_.handle(setup.request, unit, selector, sent);
    case kStreamingInterface:
      return streamRequest(setup, sent);
    default:
      return std::nullopt;
  }
}

std::optional<Bytes> UvcDevice::streamRequest(const SetupPacket& setup, ByteView sent) {
  const std::uint8_t selector = highByte(setup.value);
  if (selector != UVC_VS_PROBE_CONTROL && selector != UVC_VS_COMMIT_CONTROL) return std::nullopt;
  switch (setup.request) {
    case UVC_SET_CUR:
      return setProposal(selector, sent);
    case UVC_GET_INFO:
      return Bytes{UVC_CONTROL_CAP_GET | UVC_CONTROL_CAP_SET};
    case UVC_GET_LEN:
      return ByteWriter().le16(kProposalBytes).take();
    case UVC_GET_CUR:
    case UVC_GET_MIN:
    case UVC_GET_MAX:
    case UVC_GET_DEF: {
      // Nothing but the mode can be chosen, so that least and most are what there is.
      const Proposal& proposal = selector == UVC_VS_COMMIT_CONTROL && commit_ ? *commit_ : probe_;
      ByteWriter writer;
      writer.le16(1).u8(proposal.format_index).u8(proposal.frame_index);
      writer.le32(proposal.mode.interval_100ns).zeros(10);  // no compression parameters, no delay
      writer.le32(proposal.mode.max_frame_bytes).le32(proposal.mode.max_payload_bytes);
      return writer.zeros(kProposalBytes - writer.size()).take();
    }
    default:
      return std::nullopt;
  }
}

std::optional<Bytes> UvcDevice::setProposal(std::uint8_t selector, ByteView sent) {
  if (sent.size() != kProposalBytes && sent.size() != kOldProposalBytes) return std::nullopt;
  const auto mode = modeOf(sent[2], sent[3], readLe32(sent, 4), transfer_);
  if (!mode) return std::nullopt;
  probe_ = {sent[2], sent[3], *mode};
  if (selector == UVC_VS_COMMIT_CONTROL) commit_ = probe_;
  return Bytes{};
}

}  // namespace waymark::testing
