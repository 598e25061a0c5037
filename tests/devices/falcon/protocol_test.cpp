#include "devices/falcon/protocol.h"

#include "tests/devices/support.h"
#include "tests/support/allocations.h"

#include <algorithm>
#include <gmock/gmock.h>
#include <span>

namespace haptrace::test {
namespace {

using testing::ElementsAre;

using Bytes = std::vector<std::uint8_t>;

std::string text_of(const FalconBytes& bytes) {
  return {bytes.begin(), bytes.end()};
}

std::vector<FalconPacket> packets_in(std::span<const std::uint8_t> bytes) {
  FalconDecoder decoder;
  std::vector<FalconPacket> packets;
  for (const std::uint8_t byte : bytes)
    if (const auto packet = decoder.push(byte)) packets.push_back(*packet);
  return packets;
}

void append(Bytes& stream, const FalconPacket& packet) {
  const FalconBytes bytes = encode(packet);
  stream.insert(stream.end(), bytes.begin(), bytes.end());
}

class RandomBytes {
 public:
  explicit RandomBytes(std::uint64_t seed) : random_(seed, 5) {}

  std::size_t below(std::size_t end) { return random_.next() % end; }
  FalconPacket packet() {
    const std::uint64_t bits = random_.next();
    return {
        {static_cast<std::int16_t>(bits), static_cast<std::int16_t>(bits >> 16), static_cast<std::int16_t>(bits >> 32)},
        static_cast<std::uint8_t>(bits >> 48 & FalconPacket::kAllFlags)};
  }
  /// Returns a byte that occurs in packets, or any byte.
  std::uint8_t byte() {
    const std::uint64_t bits = random_.next();
    const auto any = static_cast<std::uint8_t>(bits >> 8);
    switch (bits % 4) {
      case 0:
        return any;
      case 1:
        return any % 2 == 0 ? '<' : '>';
      default:
        return static_cast<std::uint8_t>('A' + any % 16);
    }
  }
  /// Returns up to `longest` random bytes; that they form a packet is too unlikely to occur.
  Bytes garbage(std::size_t longest) {
    Bytes bytes(below(longest + 1));
    for (std::uint8_t& one : bytes) one = byte();
    return bytes;
  }

 private:
  SplitMix64 random_;
};

TEST(FalconProtocol, WritesPacketsAsItsSourcesDo) {
  EXPECT_EQ(text_of(encode({})), "<AAAAAAAAAAAAAA>");
  EXPECT_EQ(text_of(encode({{-1447, 0x1234, 0}, 0x01})), "<JFKPEDCBAAAABA>");
  EXPECT_EQ(text_of(encode({{0, 0, -32768}, 0xff})),
            "<AAAAAAAAAAAI\xc0"
            "A>");
}

TEST(FalconProtocol, ReadsBackEveryWordAndEveryFlag) {
  FalconDecoder decoder;
  const auto read_back = [&](const FalconPacket& packet) {
    std::optional<FalconPacket> read;
    for (const std::uint8_t byte : encode(packet)) {
      if (read) return false;
      read = decoder.push(byte);
    }
    return read == packet;
  };
  for (int value = -32768; value <= 32767; ++value) {
    const auto word = static_cast<std::int16_t>(value), other = static_cast<std::int16_t>(~value);
    const auto flags = static_cast<std::uint8_t>(value & 0x7f);
    ASSERT_TRUE(read_back({{word, 0, other}, flags})) << value;
    ASSERT_TRUE(read_back({{other, word, 0}, flags})) << value;
    ASSERT_TRUE(read_back({{0, other, word}, flags})) << value;
  }
  EXPECT_EQ(decoder.skipped(), 0);
}

TEST(FalconProtocol, HasBracketsAtTheEndsOnly) {
  RandomBytes random(1);
  for (int i = 0; i < 10'000; ++i) {
    const FalconBytes bytes = encode(random.packet());
    ASSERT_EQ(bytes.front(), '<');
    ASSERT_EQ(bytes.back(), '>');
    ASSERT_EQ(std::count(bytes.begin(), bytes.end(), '<') + std::count(bytes.begin(), bytes.end(), '>'), 2);
  }
}

TEST(FalconProtocol, FindsEveryPacketBetweenAnyGarbage) {
  RandomBytes random(2);
  for (int i = 0; i < 5000; ++i) {
    Bytes stream;
    std::vector<FalconPacket> sent;
    FalconDecoder decoder;
    std::size_t garbage = 0;
    for (int k = 0; k < 5; ++k) {
      const Bytes noise = random.garbage(40);
      stream.insert(stream.end(), noise.begin(), noise.end());
      garbage += noise.size();
      sent.push_back(random.packet());
      append(stream, sent.back());
    }
    std::vector<FalconPacket> found;
    for (const std::uint8_t byte : stream)
      if (const auto packet = decoder.push(byte)) found.push_back(*packet);
    ASSERT_EQ(found, sent) << "stream " << i;
    ASSERT_EQ(decoder.skipped(), garbage);
  }
}

TEST(FalconProtocol, FindsNoPacketThatWasNotSent) {
  RandomBytes random(3);
  std::size_t found = 0;
  for (int i = 0; i < 2000; ++i) {
    // Change up to three bytes of the stream into others that often occur in packets.
    Bytes stream = random.garbage(20);
    append(stream, random.packet());
    for (std::size_t changes = random.below(4); changes > 0; --changes)
      stream[random.below(stream.size())] = random.byte();
    FalconDecoder decoder;
    for (std::size_t k = 0; k < stream.size(); ++k) {
      const auto packet = decoder.push(stream[k]);
      if (!packet) continue;
      ++found;
      ASSERT_GE(k, 15);
      FalconBytes bytes = encode(*packet);
      bytes[14] = stream[k - 1];  // a byte without a known meaning
      ASSERT_TRUE(std::equal(bytes.begin(), bytes.end(), stream.begin() + static_cast<std::ptrdiff_t>(k - 15)));
    }
  }
  EXPECT_GT(found, 1000);
}

TEST(FalconProtocol, LosesOnlyThePacketThatLostAByteOrGotOneTooMany) {
  RandomBytes random(4);
  for (std::size_t place = 0; place < 16; ++place) {
    const std::vector<FalconPacket> all{random.packet(), random.packet(), random.packet()}, spared{all[0], all[2]};
    Bytes whole;
    for (const FalconPacket& packet : all) append(whole, packet);
    const auto at = static_cast<std::ptrdiff_t>(16 + place);
    Bytes lost = whole, more = whole, wrong = whole;
    lost.erase(lost.begin() + at);
    EXPECT_EQ(packets_in(lost), spared) << "without byte " << place;
    more.insert(more.begin() + at + 1, 'C');
    EXPECT_EQ(packets_in(more), place == 15 ? all : spared) << "one more after byte " << place;
    wrong[16 + place] = 0xff;
    EXPECT_EQ(packets_in(wrong), place == 14 ? all : spared) << "another byte " << place;
  }
}

TEST(FalconProtocol, AcceptsAnyValueInTheUndocumentedByte) {
  for (unsigned unknown = 0; unknown < 256; ++unknown) {
    const FalconPacket packet{{1, -2, 3}, 0x25};
    Bytes stream;
    append(stream, packet);
    stream[14] = static_cast<std::uint8_t>(unknown);
    append(stream, packet);
    EXPECT_THAT(packets_in(stream), ElementsAre(packet, packet)) << unknown;
  }
}

TEST(FalconProtocol, ForgetsHalfAPacketOnRequest) {
  FalconDecoder decoder;
  const FalconBytes bytes = encode({{7, 8, 9}, 0});
  for (std::size_t i = 0; i < 8; ++i) EXPECT_FALSE(decoder.push(bytes[i]));
  decoder.reset();
  for (std::size_t i = 8; i < 16; ++i) EXPECT_FALSE(decoder.push(bytes[i]));
  std::optional<FalconPacket> packet;
  for (const std::uint8_t byte : bytes) packet = decoder.push(byte);
  EXPECT_EQ(packet, (FalconPacket{{7, 8, 9}, 0}));
  EXPECT_EQ(decoder.skipped(), 16);
}

TEST(FalconProtocol, NeverTurnsALargeForceRound) {
  EXPECT_EQ(falcon_word(32'780), 32'767);  // truncated to 16 bits, it would be -32 756
  EXPECT_EQ(falcon_word(-32'780), -32'767);
  EXPECT_EQ(falcon_word(1e300), 32'767);
  EXPECT_EQ(falcon_word(-INFINITY), -32'767);
  EXPECT_EQ(falcon_word(kNaN), 0);
  EXPECT_EQ(falcon_word(-0.4), 0);
  EXPECT_EQ(falcon_word(1.6), 2);
  EXPECT_EQ(falcon_word(-4095), -4095);
}

TEST(FalconProtocol, ReportsButtonsAndHomedLegs) {
  const FalconReport report = falcon_report({{-1, 2, -3}, 0x5 | 0x10 | 0x20});
  EXPECT_THAT(report.encoders, ElementsAre(-1, 2, -3));
  EXPECT_EQ(report.buttons, FalconReport::kPlus | FalconReport::kCentre);
  EXPECT_THAT(report.homed, ElementsAre(true, true, false));
  EXPECT_FALSE(report.is_homed());
  for (unsigned flags = 0; flags < 128; ++flags)
    EXPECT_EQ(falcon_report({{}, static_cast<std::uint8_t>(flags)}).is_homed(), flags >= 0x70) << flags;
}

TEST(FalconProtocol, AllocatesNothing) {
  FalconDecoder decoder;
  const std::size_t before = allocations();
  std::optional<FalconPacket> packet;
  for (const std::uint8_t byte : encode({{falcon_word(3.2), 0, 0}, 1})) packet = decoder.push(byte);
  const FalconReport report = falcon_report(*packet);
  EXPECT_EQ(allocations(), before);
  EXPECT_EQ(report.encoders[0], 3);
}

}  // namespace
}  // namespace haptrace::test
