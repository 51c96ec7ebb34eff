#include "daemon/publish/lcm_link.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>

namespace waymark::daemon {
namespace {

std::string inWords(const std::string& url) {
  const std::optional<sockaddr_in> address = multicastAddress(url);
  if (!address) return "refused";
  char text[INET_ADDRSTRLEN] = {};
  inet_ntop(AF_INET, &address->sin_addr, text, sizeof text);
  return std::string(text) + ":" + std::to_string(ntohs(address->sin_port));
}

TEST(MulticastAddress, ReadsWhatLcmReads) {
  EXPECT_EQ(inWords("udpm://239.255.76.67:7667?ttl=0"), "239.255.76.67:7667");
  EXPECT_EQ(inWords("udpm://224.1.2.3:1"), "224.1.2.3:1");
  EXPECT_EQ(inWords("udpm://239.1.1.1?ttl=1"), "239.1.1.1:7667");
  EXPECT_EQ(inWords("udpm://"), "239.255.76.67:7667");
  EXPECT_EQ(inWords("udpm://:8000"), "239.255.76.67:8000");
}

TEST(MulticastAddress, RejectsWhatCannotWork) {
  for (const char* url :
       {"", "239.255.76.67:7667", "file:///tmp/x", "udpm://localhost:7667", "udpm://10.0.0.1:7667",
        "udpm://239.255.76.67:0", "udpm://239.255.76.67:70000", "udpm://239.255.76.67:x",
        "udpm://239.255.76.67:7667x?ttl=0", "udpm://239.255.76:7667"}) {
    EXPECT_EQ(inWords(url), "refused") << url;
  }
}

TEST(UrlOptions, ThoseThatLcmTakes) {
  for (const char* url : {"udpm://", "udpm://239.1.1.1:1", "udpm://239.1.1.1:1?",
                          "udpm://239.1.1.1:1?ttl=0", "udpm://?recv_buf_size=1000&ttl=255"}) {
    EXPECT_FALSE(wrongUrlOption(url)) << url;
  }
  for (const char* options : {"ttl", "ttl=", "ttl=-1", "ttl=256", "ttl=1x", "ttl=0&ttl=a",
                              "recv_buf_size=0", "recv_buf_size=99999999999", "TTL=1", "ttl=0,x"}) {
    EXPECT_TRUE(wrongUrlOption(std::string("udpm://?") + options)) << options;
  }
}

}  // namespace
}  // namespace waymark::daemon
