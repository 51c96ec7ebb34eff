#include "io/maps/ply_map.h"

#include <gtest/gtest.h>

namespace waymark::io {
namespace {

TEST(PlyMap, ExampleByHand) {
  PosedMarkers markers;
  markers.dictionary = "4X4_50";
  markers.markers = {{7, 2.0, {}}, {9, 1.0, {}}};
  markers.markers[1].T_w_m.p = {0.0, 0.0, 3.0};
  EXPECT_EQ(formatPlyMap(markers),
            "ply\nformat ascii 1.0\ncomment 4X4_50, metres\n"
            "element vertex 8\nproperty double x\nproperty double y\nproperty double z\n"
            "element face 2\nproperty list uchar int vertex_indices\nproperty int id\nend_header\n"
            "-1.0 1.0 0.0\n1.0 1.0 0.0\n1.0 -1.0 0.0\n-1.0 -1.0 0.0\n"
            "-0.5 0.5 3.0\n0.5 0.5 3.0\n0.5 -0.5 3.0\n-0.5 -0.5 3.0\n"
            "4 3 2 1 0 7\n4 7 6 5 4 9\n");
}

}  // namespace
}  // namespace waymark::io
