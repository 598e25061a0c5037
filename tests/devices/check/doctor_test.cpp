#include "devices/check/doctor.h"

#include "base/error.h"
#include "devices/check/usb_devices.h"
#include "tests/devices/check/diagnoses.h"
#include "tests/support/temp_folder.h"

#include <cmath>
#include <filesystem>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>
#include <unistd.h>
#include <zlib.h>

namespace haptrace {

namespace {

namespace fs = std::filesystem;
using test::find, test::finding;
using test::TempFolder;
using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

/// A root folder with the files of a machine.
class FakeRoot {
 public:
  FakeRoot() { fs::permissions(folder_.path(), fs::perms::all); }
  [[nodiscard]] const std::string& path() const { return folder_.path(); }

  FakeRoot& put(const std::string& file, const std::string& content) {
    fs::create_directories(fs::path(folder_ / file).parent_path());
    fs::remove(folder_ / file);  // rewriting a file waits for the disk on some file systems
    (void)folder_.write(file, content);
    return *this;
  }

  /// Adds a USB device with its node.
  FakeRoot& plug(const std::string& vendor, const std::string& product) {
    return put("sys/bus/usb/devices/1-2/idVendor", vendor + "\n")
        .put("sys/bus/usb/devices/1-2/idProduct", product + "\n")
        .put("sys/bus/usb/devices/1-2/busnum", "1\n")
        .put("sys/bus/usb/devices/1-2/devnum", "7\n")
        .put("sys/bus/usb/devices/1-2/power/control", "on\n")
        .put("dev/bus/usb/001/007", "");
  }
  FakeRoot& plug_falcon() { return plug("0403", "cb48"); }

 private:
  TempFolder folder_;
};

/// Drops the privileges of root, which may open every file, and restores them at the end.
class AsNobody {
 public:
  AsNobody() {
    if (seteuid(65534) != 0 && geteuid() == 0) ADD_FAILURE() << "root cannot become nobody";
  }
  ~AsNobody() {
    if (seteuid(getuid()) != 0) ADD_FAILURE() << "cannot become oneself again";
  }
};

Diagnosis system(const FakeRoot& root, const std::string& check) {
  return find(examine_system(root.path()), check);
}

// ---- laws ----

TEST(Doctor, ReportsUnknownValuesForAMachineWithoutFiles) {
  const FakeRoot empty;
  for (const char* check : {"cpu governor", "preemption", "usb autosuspend"})
    EXPECT_THAT(system(empty, check), finding(Severity::note, StartsWith("unknown: "), IsEmpty()));
  EXPECT_FALSE(stolen_time(empty.path()).has_value());
  EXPECT_THAT(find(examine_loop({.stolen = 0}, empty.path()), "hypervisor"),
              finding(Severity::note, StartsWith("unknown: "), IsEmpty()));
  EXPECT_THAT(find(examine_loop({}, empty.path()), "scheduling"),
              finding(Severity::warning, HasSubstr("rtprio is unknown"), HasSubstr("limits.d")));
}

TEST(Doctor, AcceptsAnyBytesInAnyFileWithoutAnError) {
  std::mt19937 random(7);
  const std::vector<std::string> pieces{"\n",
                                        " ",
                                        "cpu",
                                        "CapEff:",
                                        "Max locked memory",
                                        "-1",
                                        "99999999999999999999",
                                        "(",
                                        ")",
                                        "=y",
                                        "#",
                                        "PREEMPT_DYNAMIC",
                                        std::string(1, '\0'),
                                        "\x1f\x8b\x08",
                                        "preempt=",
                                        "0403",
                                        "@",
                                        "\xff\xfe"};
  FakeRoot root;
  root.plug_falcon();
  for (int round = 0; round < 100; ++round) {
    for (const char* file :
         {"proc/version", "proc/cmdline", "proc/config.gz", "proc/stat", "proc/cpuinfo", "proc/self/limits",
          "proc/self/status", "proc/sys/kernel/osrelease", "sys/kernel/realtime", "sys/kernel/debug/sched/preempt",
          "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "sys/module/usbcore/parameters/autosuspend",
          "sys/bus/usb/devices/1-2/busnum", "sys/bus/usb/devices/1-2/power/control", "sys/bus/usb/devices/1-3/idVendor",
          "sys/bus/usb-serial/devices/ttyUSB0/latency_timer", "etc/udev/rules.d/1.rules",
          "etc/security/limits.d/a.conf"}) {
      std::string content;
      for (auto n = random() % 12; n > 0; --n) content += pieces[random() % pieces.size()];
      root.put(file, content);
    }
    EXPECT_NO_THROW({
      EXPECT_GE(examine_system(root.path()).size(), 5U);
      EXPECT_EQ(examine_loop({.stolen = stolen_time(root.path())}, root.path()).size(), 5U);
    });
  }
}

TEST(Doctor, AcceptsFoldersInPlaceOfFiles) {
  FakeRoot root;
  root.put("proc/version/x", "").put("sys/kernel/realtime/x", "").put("proc/stat/x", "").put("proc/cpuinfo/x", "");
  EXPECT_THAT(system(root, "preemption"), finding(Severity::note, StartsWith("unknown"), IsEmpty()));
  EXPECT_FALSE(stolen_time(root.path()).has_value());
}

TEST(Doctor, FindsItsOwnRuleForEveryKnownDevice) {
  for (const KnownUsbDevice& device : known_usb_devices()) {
    FakeRoot root;
    root.plug(device.vendor, *device.product != '\0' ? device.product : "1234");
    const Diagnosis without = system(root, "udev rules");
    EXPECT_THAT(without, finding(Severity::warning, HasSubstr(device.name), HasSubstr(device.udev_rule())));
    EXPECT_THAT(without.remedy, AllOf(HasSubstr("sudo tee -a /etc/udev/rules.d/"), HasSubstr("udevadm trigger")));
    root.put("etc/udev/rules.d/70-haptrace.rules", "# of haptrace\n" + device.udev_rule() + "\n");
    EXPECT_THAT(system(root, "udev rules"), finding(Severity::ok, HasSubstr("every device"), IsEmpty()));
  }
}

// ---- the kernel ----

TEST(Doctor, WantsTheGovernorPerformanceOnEveryProcessor) {
  FakeRoot root;
  root.put("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance\n")
      .put("sys/devices/system/cpu/cpu10/cpufreq/scaling_governor", "performance\n")
      .put("sys/devices/system/cpu/cpufreq/scaling_governor", "powersave\n");
  EXPECT_THAT(system(root, "cpu governor"), finding(Severity::ok, HasSubstr("2 processors"), IsEmpty()));
  root.put("sys/devices/system/cpu/cpu3/cpufreq/scaling_governor", "schedutil\n");
  EXPECT_THAT(system(root, "cpu governor"),
              finding(Severity::warning, StartsWith("schedutil"), StartsWith("echo performance | sudo tee")));
}

struct PreemptionCase {
  std::vector<std::pair<std::string, std::string>> files;
  Severity severity;
  std::string model, source;
};

TEST(Doctor, ReadsThePreemptionModelWhereverItIsWritten) {
  const std::string dynamic = "Linux version 6.1.0 #1 SMP PREEMPT_DYNAMIC Debian";
  const std::vector<PreemptionCase> cases{
      {{{"sys/kernel/realtime", "1\n"}}, Severity::ok, "PREEMPT_RT", "/sys/kernel/realtime"},
      {{{"proc/version", "Linux version 6.1.0-rt #1 SMP PREEMPT_RT Debian"}},
       Severity::ok,
       "PREEMPT_RT",
       "/proc/version"},
      {{{"proc/version", "Linux version 5.4 #1 SMP PREEMPT Mon"}}, Severity::ok, "full", "/proc/version"},
      {{{"proc/version", dynamic}, {"sys/kernel/debug/sched/preempt", "none voluntary (full)\n"}},
       Severity::ok,
       "full",
       "/sys/kernel/debug/sched/preempt"},
      {{{"proc/version", dynamic}, {"sys/kernel/debug/sched/preempt", "(none) voluntary full\n"}},
       Severity::warning,
       "none",
       "/sys/kernel/debug/sched/preempt"},
      {{{"proc/version", dynamic},
        {"proc/cmdline", "quiet preempt=full ro\n"},
        {"proc/config.gz", "CONFIG_PREEMPT_NONE=y"}},
       Severity::ok,
       "full",
       "/proc/cmdline"},
      {{{"proc/version", dynamic},
        {"proc/sys/kernel/osrelease", "6.1.0\n"},
        {"boot/config-6.1.0",
         "# CONFIG_PREEMPT_NONE is not set\nCONFIG_PREEMPT_VOLUNTARY=y\nCONFIG_PREEMPT_DYNAMIC=y\n"}},
       Severity::note,
       "voluntary",
       "/boot/config-6.1.0"},
      {{{"proc/config.gz", "CONFIG_PREEMPT_NONE=y\n"}}, Severity::warning, "none", "/proc/config.gz"},
      {{{"proc/config.gz", "CONFIG_PREEMPT=y\n"}}, Severity::ok, "full", "/proc/config.gz"},
      {{{"proc/config.gz", "CONFIG_PREEMPT_LAZY=y\n"}}, Severity::ok, "lazy", "/proc/config.gz"},
  };
  for (const PreemptionCase& c : cases) {
    FakeRoot root;
    for (const auto& [file, content] : c.files) root.put(file, content);
    const Diagnosis found = system(root, "preemption");
    EXPECT_THAT(found, finding(c.severity, AllOf(StartsWith(c.model), HasSubstr("(" + c.source + ")")), testing::_));
    const bool runtime = c.files.front().second == dynamic;
    if (c.severity == Severity::ok)
      EXPECT_THAT(found.remedy, IsEmpty());
    else
      EXPECT_THAT(found.remedy, HasSubstr(runtime ? "echo full" : "apt install linux-image-rt"));
  }
}

TEST(Doctor, ReadsACompressedKernelConfiguration) {
  FakeRoot root;
  root.put("proc/x", "");
  gzFile file = gzopen((root.path() + "/proc/config.gz").c_str(), "wb");
  gzputs(file, std::string(100'000, '#').c_str());
  gzputs(file, "\nCONFIG_PREEMPT_VOLUNTARY=y\n");
  gzclose(file);
  EXPECT_THAT(system(root, "preemption"),
              finding(Severity::note, StartsWith("voluntary"), HasSubstr("linux-image-rt")));
}

// ---- devices ----

TEST(Doctor, ReportsThatAPluggedDeviceCanBeOpenedOrShowsHowToInstallItsRule) {
  FakeRoot root;
  root.plug_falcon();
  const fs::path node = root.path() + "/dev/bus/usb/001/007";
  const AsNobody nobody;
  const auto set_mode = [&](unsigned mode) {
    if (seteuid(getuid()) != 0) ADD_FAILURE();
    fs::permissions(node, fs::perms(mode));
    if (seteuid(65534) != 0 && geteuid() == 0) ADD_FAILURE();
  };
  set_mode(0666);
  EXPECT_THAT(system(root, "device 0403:cb48"),
              finding(Severity::ok, HasSubstr("Novint Falcon at 1-2: /dev/bus/usb/001/007 can be opened"), IsEmpty()));
  for (const unsigned mode : {0000U, 0444U}) {  // a force needs write access
    set_mode(mode);
    EXPECT_THAT(system(root, "device 0403:cb48"),
                finding(Severity::problem, HasSubstr("Permission denied"),
                        AllOf(HasSubstr("ATTR{idVendor}==\"0403\", ATTR{idProduct}==\"cb48\""),
                              HasSubstr("sudo tee -a /etc/udev/rules.d/70-haptrace.rules"))));
  }
}

TEST(Doctor, MissesTheNodeOfAPluggedDevice) {
  FakeRoot root;
  root.plug_falcon();
  fs::remove(root.path() + "/dev/bus/usb/001/007");
  EXPECT_THAT(system(root, "device 0403:cb48"),
              finding(Severity::problem, HasSubstr("No such file"), HasSubstr("udevadm trigger")));
  root.put("sys/bus/usb/devices/1-2/devnum", "seven");
  EXPECT_THAT(
      system(root, "device 0403:cb48"),
      finding(Severity::problem, HasSubstr("no driver has created a device file"), HasSubstr("udevadm trigger")));
}

TEST(Doctor, FindsTheNodesOfHidAndSerialDevices) {
  FakeRoot hid;
  hid.plug("16c0", "0486").put("dev/hidraw3", "");
  hid.put("sys/bus/usb/devices/1-2/1-2:1.0/0003:16C0:0486.0001/hidraw/hidraw3/dev", "1:3");
  EXPECT_THAT(system(hid, "device 16c0:0486"),
              finding(Severity::ok, HasSubstr("/dev/hidraw3 can be opened"), IsEmpty()));

  FakeRoot serial;
  serial.plug("2988", "0302").put("dev/ttyACM0", "");
  serial.put("sys/bus/usb/devices/1-2/1-2:1.0/tty/ttyACM0/dev", "1:3");
  EXPECT_THAT(system(serial, "device 2988:0302"),
              finding(Severity::ok, HasSubstr("/dev/ttyACM0 can be opened"), IsEmpty()));
}

TEST(Doctor, LeavesOtherUsbDevicesAlone) {
  FakeRoot root;
  root.plug("0403", "6001").put("sys/module/usbcore/parameters/autosuspend", "-1\n");
  EXPECT_THAT(system(root, "usb autosuspend"), finding(Severity::ok, "off", IsEmpty()));
  EXPECT_THAT(system(root, "udev rules"), finding(Severity::note, HasSubstr("no known device is plugged in"),
                                                  HasSubstr("haptrace doctor --udev-rules | sudo tee")));
}

TEST(Doctor, KeepsDevicesAwake) {
  FakeRoot root;
  root.plug_falcon();
  EXPECT_THAT(system(root, "autosuspend 0403:cb48"), finding(Severity::ok, "off", IsEmpty()));
  root.put("sys/bus/usb/devices/1-2/power/control", "auto\n");
  EXPECT_THAT(
      system(root, "autosuspend 0403:cb48"),
      finding(Severity::warning, HasSubstr("suspend"), "echo on | sudo tee /sys/bus/usb/devices/1-2/power/control"));
  fs::remove(root.path() + "/sys/bus/usb/devices/1-2/power/control");
  EXPECT_THAT(system(root, "autosuspend 0403:cb48"), finding(Severity::note, StartsWith("unknown"), IsEmpty()));

  FakeRoot nobody_plugged;
  nobody_plugged.put("sys/module/usbcore/parameters/autosuspend", "2\n");
  EXPECT_THAT(system(nobody_plugged, "usb autosuspend"),
              finding(Severity::note, HasSubstr("after 2 s"), HasSubstr("usbcore/parameters/autosuspend")));
}

TEST(Doctor, WritesTheRulesThatThePackageInstalls) {
  EXPECT_EQ(test::read_bytes(UDEV_RULES), udev_rules_file())
      << "haptrace doctor --udev-rules > devices/udev/70-haptrace.rules";
}

TEST(Doctor, DistinguishesRulesThatNameADeviceFromRulesThatDoNot) {
  const auto verdict = [](const std::string& folder, const std::string& rules) {
    FakeRoot root;
    root.plug_falcon().put(folder + "/50-a.rules", "\n" + rules + "\n");
    return system(root, "udev rules").severity;
  };
  const std::string rule = R"(SUBSYSTEM=="usb", ATTR{idVendor}=="0403", ATTR{idProduct}=="CB48", MODE="0666")";
  for (const char* folder : {"etc/udev/rules.d", "run/udev/rules.d", "usr/local/lib/udev/rules.d",
                             "usr/lib/udev/rules.d", "lib/udev/rules.d"})
    EXPECT_EQ(verdict(folder, rule), Severity::ok) << folder;
  EXPECT_EQ(verdict("etc/udev/rules.d", R"(ATTRS{idVendor}=="0403", MODE="0666")"), Severity::ok);
  EXPECT_EQ(verdict("etc/udev/rules.d", "  # " + rule), Severity::warning);
  EXPECT_EQ(verdict("etc/udev/rules.d", R"(ATTR{idVendor}=="0403", ATTR{idProduct}=="6001", MODE="0666")"),
            Severity::warning);
  EXPECT_EQ(verdict("etc/udev/rules.d", R"(ATTR{idProduct}=="0403", MODE="0666")"), Severity::warning);
  EXPECT_EQ(verdict("etc/udev", rule), Severity::warning);
}

TEST(Doctor, WantsTheLatencyTimersOfSerialPortsAtAMillisecond) {
  FakeRoot root;
  root.put("sys/bus/usb-serial/devices/ttyUSB1/port_number", "0\n");  // a chip of another kind
  EXPECT_THAT(system(root, "latency timer"), finding(Severity::ok, HasSubstr("no FTDI"), IsEmpty()));
  root.put("sys/bus/usb-serial/devices/ttyUSB0/latency_timer", "1\n");
  EXPECT_THAT(system(root, "latency timer ttyUSB0"), finding(Severity::ok, "1 ms", IsEmpty()));
  root.put("sys/bus/usb-serial/devices/ttyUSB0/latency_timer", "16\n");
  EXPECT_THAT(system(root, "latency timer ttyUSB0"),
              finding(Severity::warning, HasSubstr("16 ms"),
                      "echo 1 | sudo tee /sys/bus/usb-serial/devices/ttyUSB0/latency_timer"));
  root.put("sys/bus/usb-serial/devices/ttyUSB0/latency_timer", "sixteen");
  EXPECT_THAT(system(root, "latency timer ttyUSB0"), finding(Severity::note, StartsWith("unknown"), IsEmpty()));
}

// ---- the loop ----

LoopMeasurement good_loop() {
  LoopMeasurement loop{.rate_hz = 1000, .duration = 1, .samples = 1000, .stolen = 0};
  loop.latency.record(20'000, 1000);
  loop.realtime = {.scheduler = "SCHED_FIFO 80", .realtime = true, .memory_locked = true};
  return loop;
}

FakeRoot& with_limits(FakeRoot& root, const std::string& rtprio, const std::string& capabilities) {
  return root
      .put("proc/self/limits",
           "Limit                     Soft Limit           Hard Limit           Units     \n"
           "Max locked memory         8388608              8388608              bytes     \n"
           "Max realtime priority     " +
               rtprio + "                    99                             \n")
      .put("proc/self/status", "Name:\tx\nCapEff:\t" + capabilities + "\n");
}

TEST(Doctor, ReportsTheSchedulingOrWhyItWasRefused) {
  FakeRoot root;
  with_limits(root, "0", "0000000000000000");
  const auto scheduling = [&](const LoopMeasurement& loop) {
    return find(examine_loop(loop, root.path()), "scheduling");
  };
  EXPECT_THAT(scheduling(good_loop()), finding(Severity::ok, "SCHED_FIFO 80", IsEmpty()));
  const LoopMeasurement refused;
  EXPECT_THAT(scheduling(refused),
              finding(Severity::warning, HasSubstr("rtprio is 0"),
                      AllOf(HasSubstr("@realtime - rtprio 80"), HasSubstr("/etc/security/limits.d/haptrace.conf"))));

  root.put("etc/security/limits.d/audio.conf", "# @none - rtprio 95\n@weak - rtprio 10\n@audio - rtprio 95\n");
  EXPECT_THAT(scheduling(refused),
              finding(Severity::warning, testing::_,
                      AllOf(HasSubstr("usermod -aG audio"), HasSubstr("/etc/security/limits.d/audio.conf"))));
  root.put("etc/security/limits.d/audio.conf", "");
  root.put("etc/security/limits.conf", "ada - rtprio 90\n");
  EXPECT_THAT(scheduling(refused),
              finding(Severity::warning, testing::_, AllOf(HasSubstr("log in again"), HasSubstr("allows ada"))));

  with_limits(root, "99", "0000000000000000");
  EXPECT_THAT(scheduling(refused), finding(Severity::warning, HasSubstr("control group"), HasSubstr("cgroup.procs")));
  with_limits(root, "0", "0000000000800000");
  EXPECT_THAT(scheduling(refused), finding(Severity::warning, HasSubstr("control group"), HasSubstr("cgroup.procs")));
}

TEST(Doctor, ReportsWhetherMemoryIsLockedAndTimersAreFine) {
  FakeRoot root;
  with_limits(root, "0", "0");
  LoopMeasurement loop = good_loop();
  loop.timer_slack_ns = 50'000;
  EXPECT_THAT(find(examine_loop(loop, root.path()), "memory lock"),
              finding(Severity::ok, HasSubstr("8388608 bytes"), IsEmpty()));
  EXPECT_THAT(find(examine_loop(loop, root.path()), "timer slack"),
              finding(Severity::ok, HasSubstr("have none"), IsEmpty()));
  loop.realtime = {};
  EXPECT_THAT(find(examine_loop(loop, root.path()), "memory lock"),
              finding(Severity::warning, HasSubstr("8388608 bytes"), HasSubstr("memlock unlimited")));
  EXPECT_THAT(find(examine_loop(loop, root.path()), "timer slack"),
              finding(Severity::warning, HasSubstr("50000 ns"), HasSubstr("rtprio")));
  loop.timer_slack_ns = 1;
  EXPECT_THAT(find(examine_loop(loop, root.path()), "timer slack"), finding(Severity::ok, "1 ns", IsEmpty()));
}

TEST(Doctor, BlamesTheHypervisorForStolenTime) {
  FakeRoot root;
  root.put("proc/cpuinfo", "flags\t\t: fpu sse2\n");
  const auto hypervisor = [&](double stolen) {
    LoopMeasurement loop = good_loop();
    loop.stolen = stolen;
    return find(examine_loop(loop, root.path()), "hypervisor");
  };
  EXPECT_THAT(hypervisor(0), finding(Severity::ok, "none", IsEmpty()));
  root.put("proc/cpuinfo", "flags\t\t: fpu sse2 hypervisor lahf_lm\n");
  EXPECT_THAT(hypervisor(0), finding(Severity::note, HasSubstr("a virtual machine"), IsEmpty()));
  EXPECT_THAT(hypervisor(0.001), finding(Severity::note, HasSubstr("took 1 ms of the 1 s"), HasSubstr("on the host")));
  EXPECT_THAT(hypervisor(0.03),
              finding(Severity::warning, HasSubstr("took 30 ms of the 1 s"), HasSubstr("on the host")));
}

TEST(Doctor, ReadsStolenTimeInSeconds) {
  FakeRoot root;
  root.put("proc/stat", "cpu  39853 0 2885 87597 649 0 33 57 0 0\ncpu0 1 2 3 4 5 6 7 8 9\n");
  EXPECT_DOUBLE_EQ(stolen_time(root.path()).value(), 57.0 / static_cast<double>(sysconf(_SC_CLK_TCK)));
  root.put("proc/stat", "cpu  39853 0 2885\n");  // before Linux 2.6.11
  EXPECT_FALSE(stolen_time(root.path()).has_value());
}

TEST(Doctor, HoldsTheRateUpToOneTickInAThousandAndHalfAPeriod) {
  LoopMeasurement loop = good_loop();
  EXPECT_TRUE(loop.holds_rate());
  loop.samples = 999;
  loop.missed = 1;
  EXPECT_TRUE(loop.holds_rate());
  loop.samples = 998;
  loop.missed = 2;
  EXPECT_FALSE(loop.holds_rate());
  EXPECT_THAT(find(examine_loop(loop, "/nowhere"), "servo loop"),
              finding(Severity::problem, AllOf(HasSubstr("does not hold 1000 Hz"), HasSubstr("2 of 1000 ticks missed")),
                      HasSubstr("--rate 500")));

  loop = good_loop();
  loop.latency.record(900'000, 1);  // one sample in 1001 does not reach p99.9
  EXPECT_TRUE(loop.holds_rate());
  EXPECT_THAT(find(examine_loop(loop, "/nowhere"), "servo loop"),
              finding(Severity::ok, HasSubstr("holds 1000 Hz"), IsEmpty()));
  loop.latency.record(900'000, 1);
  EXPECT_FALSE(loop.holds_rate());
  loop.rate_hz = 500;  // half a period is 1 ms
  EXPECT_TRUE(loop.holds_rate());
}

TEST(Doctor, DoesNotHoldARateThatWasNotMeasured) {
  EXPECT_FALSE(LoopMeasurement{}.holds_rate());
}

TEST(Doctor, MeasuresTheServoLoopInTurns) {
  LoopMeasurement loop{.rate_hz = 500};
  const StopRequest stop;
  for (std::uint64_t turn = 1; turn <= 2; ++turn) {
    measure_loop(loop, 0.05, stop);
    EXPECT_GE(loop.samples + loop.missed, turn * 25);
    EXPECT_EQ(loop.latency.count(), loop.samples);
    EXPECT_EQ(loop.p999_of_turns.size(), turn);
    EXPECT_GE(loop.duration, static_cast<double>(turn) * 0.05);
  }
  EXPECT_THAT(loop.realtime.scheduler, StartsWith("SCHED_"));
}

TEST(Doctor, EndsItsLoopWhenAsked) {
  LoopMeasurement loop;
  StopRequest stop;
  stop.raise();
  measure_loop(loop, 3600, stop);
  EXPECT_LT(loop.duration, 3600);
}

// ---- cyclictest ----

TEST(Doctor, ReadsTheHistogramOfCyclictest) {
  const auto histogram = parse_cyclictest(
      "# /dev/cpu_dma_latency set to 0us\n# Histogram\n000000 000000\n000005 000990\n000040 000008\n"
      "# Total: 000000998\n# Min Latencies: 00005\n# Avg Latencies: 00005\n# Max Latencies: 23456\n"
      "# Histogram Overflows: 00002\n# Histogram Overflow at cycle number:\n# Thread 0: 00101 00203\n");
  ASSERT_TRUE(histogram.has_value());
  EXPECT_EQ(histogram->count(), 1000U);
  EXPECT_NEAR(histogram->quantile(0.5), 5e-6, 5e-6 / 32);
  EXPECT_NEAR(histogram->quantile(0.998), 40e-6, 40e-6 / 32);
  EXPECT_DOUBLE_EQ(histogram->quantile(0.999), 23456e-6);
  EXPECT_DOUBLE_EQ(histogram->max(), 23456e-6);
}

TEST(Doctor, FindsNoHistogramInOtherTexts) {
  EXPECT_FALSE(parse_cyclictest("").has_value());
  EXPECT_FALSE(parse_cyclictest("Unable to change scheduling policy!\neither run as root\n").has_value());
  EXPECT_FALSE(parse_cyclictest("# Histogram\n000000 000000\n000001 x\n\n-3\n").has_value());
}

}  // namespace
}  // namespace haptrace
