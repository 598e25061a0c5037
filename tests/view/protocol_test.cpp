#include "tests/view/page_client.h"
#include "view/frames.h"
#include "view/loopback_request.h"
#include "view/page_message.h"
#include "view/view_channels.h"

#include <cmath>
#include <cstring>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

using test::BinaryMessage;

BinaryMessage sent(const Frame& frame, std::uint32_t sequence = 7, std::uint16_t flags = 0) {
  const auto header = frame_header(frame, sequence, flags);
  return BinaryMessage(std::string(header.data(), header.size()) + frame.body);
}

TEST(ViewProtocol, RowsTravelAsPlanesAfterAHeaderOf32Bytes) {
  ViewRows rows(2);
  rows.add(1'000'000'000, std::vector<float>{1, 10});
  rows.add(1'001'000'000, std::vector<float>{2, 20});
  Frame frame = frame_of(rows);
  frame.request = 5;
  frame.flags = FrameFlags::kCut;
  const BinaryMessage message = sent(frame, 7, FrameFlags::kGap);
  EXPECT_EQ(message.kind, 1);
  EXPECT_EQ(message.version, 1);
  EXPECT_EQ(message.flags, 5);
  EXPECT_EQ(message.sequence, 7U);
  EXPECT_EQ(message.rows, 2U);
  EXPECT_EQ(message.request, 5U);
  EXPECT_EQ(message.t0, 1);
  EXPECT_THAT(message.plane(0), testing::ElementsAre(0, 1e-3F));
  EXPECT_THAT(message.plane(1), testing::ElementsAre(1, 2));
  EXPECT_THAT(message.plane(2), testing::ElementsAre(10, 20));

  const BinaryMessage newest = sent(frame_of(rows, FrameKind::state));
  EXPECT_EQ(newest.rows, 1U);
  EXPECT_EQ(newest.t0, 1.001);
  EXPECT_THAT(newest.plane(2), testing::ElementsAre(20));
}

TEST(ViewProtocol, ALongPathIsThinnedEvenlyByArcLengthAndKeepsItsEnds) {
  FollowedPath path;
  constexpr int kPoints = 50'000;
  for (int i = 0; i < kPoints; ++i) {
    const double angle = 2 * std::numbers::pi * i * i / (1.0 * kPoints * kPoints);  // faster and faster
    path.time.push_back(i);
    path.position.emplace_back(std::cos(angle), std::sin(angle), 0);
    path.radius.push_back(0.005);
  }
  path.position[777] = nan3();
  const BinaryMessage message = sent(frame_of(path));
  EXPECT_EQ(message.kind, 4);
  ASSERT_LE(message.rows, kMostPathPoints);
  ASSERT_GT(message.rows, kMostPathPoints / 2);
  const auto x = message.plane(1), length = message.plane(5);
  EXPECT_EQ(x.front(), 1);
  EXPECT_EQ(message.plane(0).back(), kPoints - 1);
  EXPECT_NEAR(length.back(), 2 * std::numbers::pi, 1e-3);
  for (std::size_t i = 1; i < length.size(); ++i) ASSERT_LT(length[i] - length[i - 1], 0.01) << i;
  EXPECT_FLOAT_EQ(message.plane(4).front(), 0.005F);
}

TEST(ViewProtocol, APathWithoutTunnelHasNoRadius) {
  const BinaryMessage message =
      sent(frame_of(FollowedPath{.time = {0, 1}, .position = {Vec3(0, 0, 0), Vec3(0, 0, 2)}}));
  EXPECT_TRUE(std::isnan(message.plane(4)[0]));
  EXPECT_THAT(message.plane(5), testing::ElementsAre(0, 2));
}

TEST(ViewProtocol, AMessageOfAPageKeepsItsValues) {
  const auto message = parse_page_message(
      R"({"type":"bins","id":3,"t0":1.5,"t1":2,"pixels":800,"channels":["x","force"],"unknown":{"a":[1]}})");
  ASSERT_TRUE(message);
  EXPECT_EQ(message->type, PageMessage::Type::bins);
  EXPECT_EQ(message->id, 3U);
  EXPECT_EQ(message->t0, 1.5);
  EXPECT_EQ(message->t1, 2);
  EXPECT_EQ(message->pixels, 800U);
  EXPECT_THAT(message->channels, testing::ElementsAre("x", "force"));
}

TEST(ViewProtocol, MessagesOfAWrongShapeAreRefused) {
  for (const char* text :
       {"", "1", "[]", "{", "null", R"({"id":1})", R"({"type":1})", R"({"type":"bins","t0":"1"})",
        R"({"type":"bins","t0":1e300})", R"({"type":"bins","id":-1})", R"({"type":"rows","id":1e20})",
        R"({"type":"bins","channels":"x"})", R"({"type":"bins","channels":[1]})", R"({"type":"hello","token":[]})",
        "{\"type\":\"command\",\"line\":\"\xff\"}"})
    EXPECT_FALSE(parse_page_message(text)) << text;
  EXPECT_FALSE(parse_page_message(std::string(4096, '[')));
}

TEST(ViewProtocol, AnUnknownTypeIsIgnoredAndAStopIsObeyedWhateverElseItSays) {
  EXPECT_EQ(parse_page_message(R"({"type":"later"})")->type, PageMessage::Type::unknown);
  EXPECT_EQ(parse_page_message(R"({"type":"stop","id":"x","t0":[]})")->type, PageMessage::Type::stop);
}

std::string intention_bytes(float x, float grip) {
  std::string bytes(56, '\0');
  bytes[0] = 8;
  std::memcpy(bytes.data() + 32, &x, sizeof x);
  std::memcpy(bytes.data() + 44, &grip, sizeof grip);
  return bytes;
}

TEST(ViewProtocol, AnIntentionIsFiniteAndItsGripFromZeroToOne) {
  const auto intention = parse_intention(intention_bytes(0.01F, 5));
  ASSERT_TRUE(intention);
  EXPECT_FLOAT_EQ(static_cast<float>(intention->position.x()), 0.01F);
  EXPECT_EQ(intention->grip, 1);
  EXPECT_FALSE(parse_intention(intention_bytes(NAN, 1)));
  EXPECT_FALSE(parse_intention(intention_bytes(INFINITY, 1)));
  EXPECT_FALSE(parse_intention(intention_bytes(0, NAN)));
  EXPECT_FALSE(parse_intention(intention_bytes(0, 1).substr(0, 55)));
  std::string other = intention_bytes(0, 1);
  other[0] = 7;
  EXPECT_FALSE(parse_intention(other));
  EXPECT_FALSE(parse_intention(""));
}

TEST(ViewProtocol, OnlyLiteralLoopbackHostsWithThePortAreAccepted) {
  for (const char* host : {"127.0.0.1:8080", "[::1]:8080", "localhost:8080"}) {
    EXPECT_TRUE(is_loopback_host(host, 8080)) << host;
    EXPECT_TRUE(is_loopback_origin(std::string("http://") + host, 8080)) << host;
    EXPECT_FALSE(is_loopback_host(host, 8081)) << host;
  }
  for (const char* host :
       {"", "127.0.0.1", "127.0.0.1:", "127.0.0.1:80800", "127.0.0.1.evil.test:8080", "evil.test:8080",
        "localhost.evil.test:8080", "127.0.0.2:8080", "LOCALHOST:8080", "127.0.0.1:8080.evil.test",
        "user@127.0.0.1:8080", "127.0.0.1:8080/", "0.0.0.0:8080", "127.0.0.1:-8080", "127.0.0.1: 8080"})
    EXPECT_FALSE(is_loopback_host(host, 8080)) << host;
  for (const char* origin : {"", "null", "https://127.0.0.1:8080", "http://evil.test", "http://evil.test:8080",
                             "http://127.0.0.1", "file://", "ws://127.0.0.1:8080"})
    EXPECT_FALSE(is_loopback_origin(origin, 8080)) << origin;
  EXPECT_TRUE(is_loopback_origin(std::nullopt, 8080)) << "a program that is no browser";
  EXPECT_TRUE(is_loopback_host("localhost", 80));
}

TEST(ViewProtocol, GzipIsUsedOnlyForClientsThatAcceptIt) {
  for (const char* value : {"gzip", "deflate, gzip", "br;q=1.0, gzip;q=0.8", "gzip ; q=0.001"})
    EXPECT_TRUE(accepts_gzip(value)) << value;
  for (const char* value : {"", "br", "gzip;q=0", "gzip;q=0.000", "xgzip", "identity"})
    EXPECT_FALSE(accepts_gzip(value)) << value;
}

TEST(ViewProtocol, ASessionHasTheColumnsThatItMeasuresInTheOrderOfTheProtocol) {
  const auto names = [](const RecordingColumns& columns) {
    const ViewChannels channels(columns);
    std::string text;
    for (std::size_t i = 0; i < channels.size(); ++i) text += std::string(channels[i].name) + " ";
    return text;
  };
  EXPECT_EQ(names({}), "x y z fx fy fz force speed phase buttons ");
  EXPECT_EQ(
      names({.orientation = true, .force_measured = true, .reference = true, .guidance = true, .tunnel = true}),
      "x y z rx ry rz fx fy fz ex ey ez progress radius deviation force speed phase buttons mx my mz qw qx qy qz ");
}

}  // namespace
}  // namespace haptrace
