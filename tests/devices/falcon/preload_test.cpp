// Tests of third-party programs on an emulated Falcon. Every test runs under LD_PRELOAD of libhaptrace-falcon-usb.so
// and calls libusb as such programs do. The preloaded library replaces the system's libusb.
#include "devices/falcon/calibration.h"
#include "devices/falcon/driver.h"
#include "devices/falcon/firmware.h"
#include "devices/falcon/protocol.h"
#include "devices/falcon/usb_link.h"
#include "devices/loop/clock.h"
#include "devices/loop/threaded_device.h"
#include "tests/devices/support.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <libusb.h>

namespace haptrace::test {
namespace {

FalconPort emulated_port() {
  return {.port = "1", .serial = "EMULATED", .bus = 1, .address = 2, .node = "/dev/null", .driver = "", .refused = 0};
}

TEST(FalconForOtherPrograms, IsListedAsADeviceOfUsb) {
  libusb_context* context = nullptr;
  ASSERT_EQ(libusb_init(&context), 0);
  libusb_device** list = nullptr;
  ASSERT_EQ(libusb_get_device_list(context, &list), 1);
  libusb_device_descriptor descriptor{};
  ASSERT_EQ(libusb_get_device_descriptor(list[0], &descriptor), 0);
  EXPECT_EQ(descriptor.idVendor, 0x0403);
  EXPECT_EQ(descriptor.idProduct, 0xcb48);
  EXPECT_EQ(list[1], nullptr);

  libusb_device_handle* handle = nullptr;
  ASSERT_EQ(libusb_open(list[0], &handle), 0);
  libusb_free_device_list(list, 1);
  std::array<unsigned char, 64> text{};
  EXPECT_GT(libusb_get_string_descriptor_ascii(handle, descriptor.iProduct, text.data(), 64), 0);
  EXPECT_STREQ(reinterpret_cast<const char*>(text.data()), "FALCON HAPTIC");
  libusb_config_descriptor* config = nullptr;
  ASSERT_EQ(libusb_get_active_config_descriptor(libusb_get_device(handle), &config), 0);
  EXPECT_EQ(config->interface[0].altsetting[0].bNumEndpoints, 2);
  libusb_free_config_descriptor(config);

  // A second handle cannot claim the interface while the first one holds it.
  libusb_device_handle* second = libusb_open_device_with_vid_pid(context, 0x0403, 0xcb48);
  ASSERT_NE(second, nullptr);
  EXPECT_EQ(libusb_claim_interface(handle, 0), 0);
  EXPECT_EQ(libusb_claim_interface(second, 0), LIBUSB_ERROR_BUSY);
  libusb_close(handle);
  EXPECT_EQ(libusb_claim_interface(second, 0), 0);
  libusb_close(second);
  EXPECT_EQ(libusb_open_device_with_vid_pid(context, 0x0403, 0x6001), nullptr);
  libusb_exit(context);
}

/// Loads "firmware" into a Falcon after power-on, through haptrace's driver and libusb's asynchronous transfers. Then
/// exchanges packets until the legs are homed, and pushes.
TEST(FalconForOtherPrograms, TakesFirmwareIsHomedAndPushes) {
  const FalconFirmware firmware{.file = "made-up.bin", .image = std::vector<std::uint8_t>(4500, 0x5a)};
  const FalconCalibration calibration;
  auto link = start_falcon([] { return open_usb_falcon_link(emulated_port()); }, firmware);
  ThreadedDevice device(std::make_unique<FalconDriver>(std::move(link), calibration, falcon_info(calibration)));
  DeviceState state;
  const auto exchange_until = [&](const Vec3& force, const auto& condition) {
    for (int k = 0; k < 30'000 && !condition(); ++k) {
      ASSERT_EQ(device.exchange({force, Vec3::Zero()}, 1e-3, state), Device::Status::ok) << device.lost_reason();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  };
  exchange_until(Vec3::Zero(), [&] { return state.ready; });
  ASSERT_TRUE(state.ready);
  const Vec3 before = state.position;
  exchange_until(Vec3(0, 0, 2), [&] { return state.position.z() - before.z() > 1e-3; });
  EXPECT_GT(state.position.z() - before.z(), 1e-3);
  device.close();
}

/// Uses blocking transfers: sends a packet and reads the answer, with the chip's two status bytes.
TEST(FalconForOtherPrograms, AnswersProgramsThatWaitForEveryTransfer) {
  const FalconFirmware firmware{.file = "made-up.bin", .image = std::vector<std::uint8_t>(4500, 0x5a)};
  start_falcon([] { return open_usb_falcon_link(emulated_port()); }, firmware)->close();

  libusb_context* context = nullptr;
  ASSERT_EQ(libusb_init(&context), 0);
  libusb_device_handle* handle = libusb_open_device_with_vid_pid(context, 0x0403, 0xcb48);
  ASSERT_NE(handle, nullptr);
  ASSERT_EQ(libusb_claim_interface(handle, 0), 0);
  EXPECT_EQ(libusb_control_transfer(handle, 0x40, 0x77, 0, 0, nullptr, 0, 100), LIBUSB_ERROR_PIPE)
      << "a request that the chip does not know";
  int answers = 0;
  for (int k = 0; k < 200 && answers < 20; ++k) {
    FalconBytes packet = encode(FalconPacket{});
    int sent = 0;
    ASSERT_EQ(libusb_bulk_transfer(handle, 0x02, packet.data(), static_cast<int>(packet.size()), &sent, 1000), 0);
    ASSERT_EQ(sent, static_cast<int>(packet.size()));
    std::array<unsigned char, 64> answer{};
    int received = 0;
    const int result = libusb_bulk_transfer(handle, 0x81, answer.data(), 64, &received, 1000);
    ASSERT_EQ(result, 0);
    ASSERT_GE(received, 2);
    if (received == 2 + static_cast<int>(packet.size()) && answer[2] == '<') ++answers;
  }
  EXPECT_EQ(answers, 20);
  // Without a packet, only the two status bytes arrive, and the transfer still ends.
  std::array<unsigned char, 64> idle{};
  int received = 0;
  EXPECT_EQ(libusb_bulk_transfer(handle, 0x81, idle.data(), 64, &received, 1000), 0);
  EXPECT_EQ(libusb_release_interface(handle, 0), 0);
  libusb_close(handle);
  libusb_exit(context);
}

}  // namespace
}  // namespace haptrace::test
