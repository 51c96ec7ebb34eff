#include "capture/wire_reader.h"

#include <array>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::capture {
namespace {

using Bytes = std::vector<std::uint8_t>;

TEST(WireReader, ReadsWhatLcmWrites) {
  const Bytes bytes{0, 0, 0, 0,   0,   0, 1, 2, 0xff, 0xff, 0xff, 0xfe, 0,
                    0, 0, 3, 'a', 'b', 0, 0, 0, 0,    2,    7,    8};
  WireReader reader(bytes);
  EXPECT_EQ(reader.int64(), 258);
  EXPECT_EQ(reader.int32(), -2);
  EXPECT_EQ(reader.text(), "ab");
  const auto raw = reader.bytes(reader.count());
  ASSERT_EQ(raw.size(), 2U);
  EXPECT_EQ(raw[1], 8);
  EXPECT_TRUE(reader.done());
}

TEST(WireReader, LengthsThatCannotBeAreRejected) {
  for (const Bytes& bytes : {Bytes{0x7f, 0xff, 0xff, 0xff, 1}, Bytes{0x80, 0, 0, 0, 1},
                             Bytes{0, 0, 0, 2, 1}, Bytes{0, 0}}) {
    WireReader array(bytes);
    EXPECT_TRUE(array.bytes(array.count()).empty());
    EXPECT_FALSE(array.ok());
    EXPECT_EQ(array.int64(), 0) << "from then on nothing is there";
    WireReader text(bytes);
    EXPECT_EQ(text.text(), "");
    EXPECT_FALSE(text.ok());
  }
  const Bytes few{0, 0, 0, 3, 0, 0, 0, 0, 0, 0};
  WireReader elements(few);
  EXPECT_EQ(elements.count(4), 0) << "three of four bytes each are more than there is";
  EXPECT_FALSE(elements.ok());
}

TEST(WireReader, TextEndsWithAZero) {
  const Bytes bytes{0, 0, 0, 2, 'a', 'b'};
  WireReader reader(bytes);
  EXPECT_EQ(reader.text(), "");
  EXPECT_FALSE(reader.ok());
}

}  // namespace
}  // namespace waymark::capture
