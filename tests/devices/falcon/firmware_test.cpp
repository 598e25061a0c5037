#include "devices/falcon/firmware.h"

#include "tests/devices/falcon/scripted_link.h"
#include "tests/devices/support.h"

#include <gmock/gmock.h>

namespace haptrace::test {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;
using Request = FalconLink::Request;

Bytes random_image(std::size_t size) {
  SplitMix64 random(5, 1);
  Bytes image(size);
  for (std::uint8_t& byte : image) byte = static_cast<std::uint8_t>(random.next());
  return image;
}

/// The device's side: the boot loader after power-on, then the loaded firmware.
class FalconLoader {
 public:
  enum class Listens : std::uint8_t { nothing, greeting, begin, image, packets };

  explicit FalconLoader(FalconScript& script, Bytes image) : script_(script), image_(std::move(image)) {
    script_.on_control = [this](Request request, std::uint16_t value) { control(request, value); };
    script_.on_write = [this](const Bytes& bytes) { hear(bytes); };
  }

  Listens listens = Listens::nothing;
  int loadings = 0;    ///< loadings started
  int bad_echoes = 0;  ///< number of loadings, from the first, with a wrong byte in the echo
  int deaf = 3;        ///< first greetings left without an answer
  Bytes welcome{0x0a, 0x44, 0x2c, 0x0d}, begins{0x41};
  std::size_t silent_after = SIZE_MAX, one_more_at = SIZE_MAX;  ///< positions in the image [bytes]
  bool starts = true;

  [[nodiscard]] bool has_image() const { return taken_ == image_; }

 private:
  void control(Request request, std::uint16_t value) {
    if (request == Request::latency_timer) latency_ = value;
    if (request == Request::baud) baud_ = value;
    if (request == Request::modem && value == 0x0101 && listens != Listens::packets) {  // DTR goes high
      listens = Listens::greeting;
      greetings_ = 0;
    }
    if (request == Request::modem && value == 0x0100 && listens == Listens::greeting && greetings_ > deaf)
      listens = Listens::begin;
  }

  void hear(const Bytes& bytes) {
    if (listens == Listens::greeting && baud_ == 0x4138 && latency_ == 16 && bytes == Bytes{0x0a, 0x43, 0x0d}) {
      if (++greetings_ > deaf) script_.line.push_back(welcome);
    } else if (listens == Listens::begin && baud_ == 0x0015 && bytes == Bytes{0x41}) {
      script_.line.push_back(begins);
      taken_.clear();
      ++loadings;
      listens = Listens::image;
    } else if (listens == Listens::image && baud_ == 0x0015) {
      take(bytes);
    } else if (listens == Listens::packets && baud_ == 0x0002 && bytes.size() == 16) {
      script_.say(encode({}));
    }
  }

  void take(const Bytes& bytes) {
    EXPECT_LE(bytes.size(), 62);
    Bytes echo = bytes;
    if (taken_.size() >= silent_after) echo.clear();
    if (loadings <= bad_echoes && taken_.size() > 3000) echo.back() ^= 0x10;
    if (taken_.size() >= one_more_at) echo.push_back(0);
    taken_.insert(taken_.end(), bytes.begin(), bytes.end());
    // Echoes may arrive in two pieces.
    const auto middle = echo.begin() + static_cast<std::ptrdiff_t>(echo.size() / 2);
    if (!echo.empty()) script_.line.emplace_back(echo.begin(), middle);
    if (!echo.empty()) script_.line.emplace_back(middle, echo.end());
    if (has_image() && starts) listens = Listens::packets;
  }

  FalconScript& script_;
  Bytes image_, taken_;
  int greetings_ = 0, latency_ = 0, baud_ = 0;
};

class FalconFirmwareTest : public testing::Test {
 protected:
  FalconScript script_;
  FalconFirmware firmware_{.file = "nvent.bin", .image = random_image(8492)};
  std::unique_ptr<FalconLoader> device_ = switched_on();

  std::unique_ptr<FalconLoader> switched_on() { return std::make_unique<FalconLoader>(script_, firmware_.image); }

  std::unique_ptr<FalconLink> start(bool named = true) {
    return start_falcon([this] { return script_.open(); },
                        named ? std::optional<FalconFirmware>(firmware_) : std::nullopt);
  }
  std::string failure(bool named = true) {
    return error_of([&] { (void)start(named); }, Error::Kind::device);
  }
};

TEST_F(FalconFirmwareTest, LoadsTheFileThatTheUserNamedAndFindsItRunning) {
  const auto link = start();
  EXPECT_TRUE(device_->has_image());
  EXPECT_EQ(device_->loadings, 1);
  EXPECT_EQ(script_.opened - script_.closed, 1);
}

TEST_F(FalconFirmwareTest, LoadsNothingWhereFirmwareRuns) {
  device_->listens = FalconLoader::Listens::packets;
  const auto link = start(false);
  EXPECT_EQ(device_->loadings, 0);
  EXPECT_EQ(script_.opened, 1);
  for (const Bytes& bytes : script_.written)
    EXPECT_EQ(std::string(bytes.begin(), bytes.end()), "<AAAAAAAAAAAAAA>") << "a probe moves nothing";
}

TEST_F(FalconFirmwareTest, NamesASourceOfFirmwareWhenNoneRunsAndNoneIsGiven) {
  EXPECT_THAT(failure(false), AllOf(HasSubstr("falcon:firmware=FILE"), HasSubstr("libnifalcon")));
  EXPECT_EQ(script_.closed, script_.opened);
}

TEST_F(FalconFirmwareTest, SucceedsInTheSixthTryOnItsOwnLink) {
  device_->bad_echoes = 5;
  const auto link = start();
  EXPECT_TRUE(device_->has_image());
  EXPECT_EQ(device_->loadings, 6);
  EXPECT_EQ(script_.opened, 6);
  EXPECT_EQ(script_.closed, 5);
}

TEST_F(FalconFirmwareTest, ReportsAfterTenTriesTheErrorOfEach) {
  device_->bad_echoes = 100;
  EXPECT_THAT(
      failure(),
      AllOf(StartsWith(
                "nvent.bin: the firmware could not be loaded into the Falcon in 10 tries (tries 1 to 10: byte 3100 "),
            HasSubstr("Switch its power off and on")));
  EXPECT_EQ(script_.opened, 10);
  EXPECT_EQ(script_.closed, 10);
}

TEST_F(FalconFirmwareTest, DistinguishesFailures) {
  device_->silent_after = 620;
  EXPECT_THAT(failure(), HasSubstr("after 620 of 8492 bytes, its loader stopped answering"));
  device_ = switched_on();
  device_->one_more_at = 620;
  EXPECT_THAT(failure(),
              AllOf(HasSubstr("tries 1 to 10: more bytes came back than were sent, after 620 of 8492 bytes")));
  device_ = switched_on();
  device_->begins = {0x41, 0x41};
  EXPECT_THAT(failure(), HasSubstr("its loader answered 41 41 to the start command"));
  device_->begins = {0x40};
  EXPECT_THAT(failure(), HasSubstr("its loader answered 40 to the start command"));
  device_ = switched_on();
  device_->welcome = {0x0a, 0x44, 0x2d, 0x0d};
  EXPECT_THAT(failure(), HasSubstr("its loader answered 0a 44 2d 0d to the greeting"));
  device_->deaf = 1'000'000;
  EXPECT_THAT(failure(), HasSubstr("its loader answered nothing to the greeting"));
  device_ = switched_on();
  device_->starts = false;
  EXPECT_THAT(failure(), HasSubstr("the firmware was loaded, but it does not answer"));
}

TEST_F(FalconFirmwareTest, TakesTheWelcomeInItsOtherFormAndOneThatComesTwice) {
  device_->welcome = {0x00, 0x0a, 0x44, 0x2c, 0x0d};
  EXPECT_NE(start(), nullptr);
  device_ = switched_on();
  script_.on_write = [this, hear = script_.on_write](const Bytes& bytes) {
    hear(bytes);
    if (bytes.size() == 3 && !script_.line.empty()) script_.line.push_back(device_->welcome);
  };
  EXPECT_NE(start(), nullptr);
}

TEST_F(FalconFirmwareTest, KeepsTryingWhileTheDeviceIsAwayForAMoment) {
  device_->bad_echoes = 1;
  int opened = 0;
  const auto link = start_falcon(
      [&] {
        if (++opened == 2) throw device_error("none is plugged in");
        return script_.open();
      },
      firmware_);
  EXPECT_TRUE(device_->has_image());
  EXPECT_EQ(opened, 3);
}

TEST(FalconFirmwareFile, IsReadCompletelyAndRejectedIfItsSizeIsWrong) {
  const TempFolder folder;
  const Bytes image = random_image(8492);
  const std::string file = folder.write("good.bin", std::string(image.begin(), image.end()));
  EXPECT_EQ(read_falcon_firmware(file).image, image);
  const auto refusal = [](const std::string& name) { return error_of([&] { (void)read_falcon_firmware(name); }); };
  EXPECT_THAT(refusal(folder / "none.bin"), AllOf(HasSubstr("none.bin: there is no such file"), HasSubstr("FILE")));
  EXPECT_THAT(refusal(folder.path()), HasSubstr("there is no such file"));
  EXPECT_THAT(refusal(folder.write("empty.bin", "")), HasSubstr("has 0 bytes; a Falcon's firmware has 7 to 9 kB"));
  EXPECT_THAT(refusal(folder.write("page.html", std::string(200'000, 'x'))), HasSubstr("has 200000 bytes"));
}

}  // namespace
}  // namespace haptrace::test
