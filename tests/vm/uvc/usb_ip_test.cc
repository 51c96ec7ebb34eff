// Expected bytes are written out by hand from the protocol's description.
#include "tests/vm/uvc/usb_ip.h"

#include <cerrno>

#include <gtest/gtest.h>

namespace waymark::testing::usb_ip {
namespace {

// The four bytes of each number, big-endian.
Bytes words(const std::vector<std::uint32_t>& values) {
  ByteWriter writer;
  for (const std::uint32_t value : values) writer.be32(value);
  return writer.take();
}

Bytes concatenated(Bytes first, const Bytes& second) {
  first.insert(first.end(), second.begin(), second.end());
  return first;
}

TEST(UsbIp, NumbersAreBigEndian) {
  EXPECT_EQ(words({0x01020304}), (Bytes{1, 2, 3, 4}));
  EXPECT_EQ(readBe32(Bytes{0, 1, 2, 3, 4}, 1), 0x01020304U);
}

TEST(UsbIp, ReadsAControlTransfer) {
  // GET_DESCRIPTOR (device), 64 bytes from endpoint 0.
  Bytes header = words({1, 77, 0x00010002, 1, 0, 0x200, 64, 0, 0, 0});
  header = concatenated(header, {0x80, 0x06, 0x00, 0x01, 0x00, 0x00, 0x40, 0x00});
  ASSERT_EQ(header.size(), kHeaderBytes);

  const Result<Command> command = parseCommand(header);
  ASSERT_TRUE(command);
  const auto& submit = std::get<Submit>(*command);
  EXPECT_EQ(submit.sequence, 77U);
  EXPECT_TRUE(submit.in);
  EXPECT_EQ(submit.endpoint, 0U);
  EXPECT_EQ(submit.length, 64U);
  EXPECT_EQ(submit.packets, 0U);
  EXPECT_EQ(submit.setup[1], 0x06);
  EXPECT_EQ(submit.setup[6], 0x40);
  EXPECT_EQ(sentBytes(submit), 0U) << "what comes back is not sent along";
  EXPECT_EQ(packetTableBytes(submit), 0U);
}

TEST(UsbIp, TransfersToTheDeviceCarryTheirData) {
  const Bytes header = words({1, 78, 2, 0, 0, 0, 34, 0, 0xffffffff, 0, 0, 0});
  const Result<Command> command = parseCommand(header);
  ASSERT_TRUE(command);
  const auto& submit = std::get<Submit>(*command);
  EXPECT_FALSE(submit.in);
  EXPECT_EQ(sentBytes(submit), 34U);
  EXPECT_EQ(submit.packets, 0U) << "-1 means that there are none";
}

TEST(UsbIp, IsochronousTransfersHaveATable) {
  const Bytes header = words({1, 79, 2, 1, 1, 0, 6144, 0, 2, 1, 0, 0});
  const Result<Command> command = parseCommand(header);
  ASSERT_TRUE(command);
  const auto& submit = std::get<Submit>(*command);
  EXPECT_EQ(submit.endpoint, 1U);
  EXPECT_EQ(packetTableBytes(submit), 32U);
  const std::vector<IsoPacket> packets = parsePackets(words({0, 3072, 0, 0, 3072, 3072, 0, 0}));
  EXPECT_EQ(packets, (std::vector<IsoPacket>{{0, 3072, 0, 0}, {3072, 3072, 0, 0}}));
}

TEST(UsbIp, ReadsAnUnlink) {
  const Bytes header = words({2, 80, 2, 0, 0, 79, 0, 0, 0, 0, 0, 0});
  const Result<Command> command = parseCommand(header);
  ASSERT_TRUE(command);
  EXPECT_EQ(std::get<Unlink>(*command).sequence, 80U);
  EXPECT_EQ(std::get<Unlink>(*command).target, 79U);
}

TEST(UsbIp, OtherMessagesAreErrors) {
  for (const std::uint32_t kind : {0U, 3U, 4U, 5U, 0x80000001U}) {
    Bytes header = words({kind});
    header.resize(kHeaderBytes);
    EXPECT_FALSE(parseCommand(header)) << kind;
  }
}

TEST(UsbIp, WritesTheReplyToAnIsochronousTransfer) {
  const SubmitReply reply{79, 0, 3, {7, 8, 9}, {{0, 3072, 3, 0}, {3072, 3072, 0, 0}}};
  Bytes expected = words({3, 79, 0, 0, 0, 0, 3, 0, 2, 0, 0, 0});
  expected = concatenated(expected, {7, 8, 9});
  expected = concatenated(expected, words({0, 3072, 3, 0, 3072, 3072, 0, 0}));
  EXPECT_EQ(encode(reply), expected);
}

TEST(UsbIp, WritesErrorsAsNegatedErrno) {
  EXPECT_EQ(encode(SubmitReply{1, -EPIPE, 0, {}, {}}),
            words({3, 1, 0, 0, 0, 0xffffffe0, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(encode(UnlinkReply{80, -ECONNRESET}),
            words({4, 80, 0, 0, 0, 0xffffff98, 0, 0, 0, 0, 0, 0}));
}

TEST(UsbIp, TheHostsSideIsTheOtherEnd) {
  Submit submit;
  submit.sequence = 5;
  submit.endpoint = 0;
  submit.length = 2;
  submit.setup = {0x21, 1, 0, 2, 0, 1, 2, 0};
  const Bytes sent = {0xaa, 0xbb};
  const Bytes message = encode(submit, sent, {});
  ASSERT_EQ(message.size(), kHeaderBytes + 2);
  const Result<Command> command = parseCommand(ByteView(message).first(kHeaderBytes));
  ASSERT_TRUE(command);
  EXPECT_EQ(std::get<Submit>(*command).setup, submit.setup);
  EXPECT_EQ(sentBytes(std::get<Submit>(*command)), 2U);

  const Result<Command> unlink = parseCommand(encode(Unlink{6, 5}));
  ASSERT_TRUE(unlink);
  EXPECT_EQ(std::get<Unlink>(*unlink).target, 5U);

  const Result<Reply> reply = parseReply(encode(SubmitReply{5, -EPIPE, 0, {}, {}}));
  ASSERT_TRUE(reply);
  EXPECT_EQ(std::get<SubmitReply>(*reply).status, -EPIPE);
  const Result<Reply> unlinked = parseReply(encode(UnlinkReply{6, -ECONNRESET}));
  ASSERT_TRUE(unlinked);
  EXPECT_EQ(std::get<UnlinkReply>(*unlinked).status, -ECONNRESET);
  EXPECT_FALSE(parseReply(encode(Unlink{6, 5})));
}

}  // namespace
}  // namespace waymark::testing::usb_ip
