// Tests of the control socket with clients on real sockets, including clients that send garbage, stall or vanish.
#include "player/tuning/tuning_server.h"

#include "player/tuning/live_tuning.h"
#include "tests/support/errors.h"
#include "tests/support/temp_folder.h"

#include <boost/asio.hpp>
#include <chrono>
#include <filesystem>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <thread>

namespace haptrace {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using test::error_of;
using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

const Tuning kServed{.gains = {Vec3::Constant(1000), Vec3::Constant(10)}};

const std::string kToken = "0123456789abcdef0123456789abcdef";

/// A client that waits for its answers.
class Client {
 public:
  /// Connects to the Unix socket.
  explicit Client(const std::string& path) : socket_(io_) {
    socket_.connect(asio::local::stream_protocol::endpoint(path));
  }

  /// Connects to the port, without a token yet.
  explicit Client(std::uint16_t port, const std::string& address = "127.0.0.1") : socket_(io_) {
    socket_.connect(tcp::endpoint(asio::ip::make_address(address), port));
  }

  void send(std::string_view text) { asio::write(socket_, asio::buffer(text)); }

  /// Sends in pieces until the server closes the connection.
  void attack(std::string_view text, std::size_t piece) {
    boost::system::error_code refused;
    for (; !text.empty() && !refused; text.remove_prefix(std::min(piece, text.size())))
      asio::write(socket_, asio::buffer(text.substr(0, piece)), refused);
  }

  /// Returns the next line, or "closed".
  std::string line() {
    boost::system::error_code error;
    const std::size_t size = asio::read_until(socket_, asio::dynamic_buffer(received_), '\n', error);
    if (error) return "closed";
    std::string text = received_.substr(0, size - 1);
    received_.erase(0, size);
    return text;
  }

  std::string ask(const std::string& command) {
    send(command + "\n");
    return line();
  }

  asio::generic::stream_protocol::socket& socket() { return socket_; }

 private:
  asio::io_context io_;
  asio::generic::stream_protocol::socket socket_;
  std::string received_;
};

class TuningServerTest : public testing::Test {
 protected:
  /// Returns a browser's requests as bytes on the wire; a web page controls all text after an empty line.
  static std::vector<std::string> requests() {
    const std::string body = "\r\n\r\nkp 5000\nkp 5000\r\n";
    return {"POST / HTTP/1.1\r\nHost: 127.0.0.1" + body,
            "POST /" + std::string(300, 'a') + " HTTP/1.1\r\nHost: 127.0.0.1" + body,
            "POST /" + std::string(5000, 'a') + " HTTP/1.1\r\nHost: rebound.example" + body,
            "GET /%0akp%205000 HTTP/1.1\r\nUpgrade: websocket\r\nConnection: Upgrade" + body,
            "OPTIONS * HTTP/1.1\r\nAccess-Control-Request-Private-Network: true" + body,
            "PRI * HTTP/2.0\r\n\r\nSM" + body,
            // A TLS handshake with a session number chosen by the attacker.
            std::string("\x16\x03\x01\x02\x00\x01", 6) + body};
  }

  const test::TempFolder folder;
  const std::string path = folder / "tune.sock";
  LiveTuning tuning{
      kServed,
      {.limits = {.largest = {Vec3::Constant(5200), Vec3::Constant(60)}, .because = "stability limit of this device"}}};
  TuningServer server{tuning, {.socket = path, .port = 0, .token = kToken}};
};

TEST_F(TuningServerTest, ObeysALineAndAnswersALine) {
  Client client(path);
  EXPECT_EQ(client.ask("kp 2000"), "ok kp 2000 2000 2000");
  EXPECT_EQ(tuning.wanted().gains.kp, Vec3::Constant(2000));
  EXPECT_EQ(client.ask("kp 9000\r"),
            "ok kp 5200 5200 5200 clamped from 9000: 5200 is the stability limit of this device");
  EXPECT_THAT(client.ask("kq 1"), AllOf(StartsWith("error "), HasSubstr("'kp'")));
  EXPECT_EQ(nlohmann::json::parse(client.ask("get"))["kp"][0], 5200);
  EXPECT_EQ(client.ask("quit"), "ok bye");
  EXPECT_EQ(client.line(), "closed");
}

TEST_F(TuningServerTest, ObeysAClientOfThePortOnceItHasShownTheToken) {
  Client client(server.port());
  client.send("token " + kToken + "\r\nkp 2000\nkq 1\n");
  EXPECT_EQ(client.line(), "ok kp 2000 2000 2000");
  EXPECT_THAT(client.line(), AllOf(StartsWith("error "), HasSubstr("'kp'"))) << "an operator may mistype";
  client.send("get k");
  client.send("p\n");
  EXPECT_EQ(client.line(), "ok kp 2000 2000 2000");

  for (const std::string& wrong :
       {std::string("token x"), "token " + kToken + "0", "token " + kToken.substr(1), std::string("token ")}) {
    Client guesser(server.port());
    EXPECT_THAT(guesser.ask(wrong), HasSubstr("not the token"));
    EXPECT_EQ(guesser.line(), "closed");
  }
}

TEST_F(TuningServerTest, ClosesThePortToEveryOtherFirstLineWithoutAnAnswer) {
  std::vector<std::string> attacks = requests();
  for (const char* text : {"kp 5000\n", "\nkp 5000\n", " \n", "token\nkp 5000\n", "TOKEN x\nkp 5000\n", "tokens"})
    attacks.emplace_back(text);
  attacks.push_back("\xef\xbb\xbftoken " + kToken + "\nkp 5000\n");
  attacks.push_back("token " + std::string(1U << 20U, 'k') + "\nkp 5000\n");
  attacks.push_back(std::string(1U << 20U, 'k') + "\nkp 5000\n");
  for (const std::string& attack : attacks)
    for (const std::size_t piece : {attack.size(), std::size_t{1}}) {
      if (piece == 1 && attack.size() > 10'000) continue;  // the server closes long before its end
      Client client(server.port());
      client.attack(attack, piece);
      EXPECT_EQ(client.line(), "closed") << attack.substr(0, 40);
    }
  EXPECT_EQ(tuning.wanted().gains.kp, kServed.gains.kp);
}

TEST_F(TuningServerTest, ObeysNoBrowserThatAForwardedPortLetsToTheSocket) {
  for (const std::string& request : requests())
    for (const std::size_t piece : {request.size(), std::size_t{1}}) {
      Client client(path);
      client.attack(request, piece);
      EXPECT_THAT(client.line(), testing::AnyOf("closed", StartsWith("error "))) << request.substr(0, 40);
      EXPECT_EQ(client.line(), "closed") << request.substr(0, 40);
    }
  EXPECT_EQ(tuning.wanted().gains.kp, kServed.gains.kp);
}

TEST_F(TuningServerTest, MakesASocketThatOnlyItsUserCanOpenAndRemovesIt) {
  const auto mode = [](const std::string& file) { return std::filesystem::status(file).permissions(); };
  EXPECT_EQ(mode(path), std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  EXPECT_THAT(error_of([&] { TuningServer second(tuning, {.socket = path}); }), HasSubstr("another session listens"));
  EXPECT_EQ(Client(path).ask("get kd"), "ok kd 10 10 10") << "the first server keeps listening";

  const std::string own = folder / "own.sock";
  { const TuningServer other(tuning, {.socket = own}); }
  EXPECT_FALSE(std::filesystem::exists(own));
}

TEST_F(TuningServerTest, ReplacesADeadSocketAndNothingElse) {
  const std::string dead = folder / "dead.sock";
  {
    asio::io_context io;
    asio::local::stream_protocol::acceptor left(io, asio::local::stream_protocol::endpoint(dead));
  }
  ASSERT_TRUE(std::filesystem::exists(dead));
  const TuningServer replacing(tuning, {.socket = dead});
  EXPECT_EQ(Client(dead).ask("get kd"), "ok kd 10 10 10");

  const std::string file = folder.write("file", "precious");
  EXPECT_THAT(error_of([&] { TuningServer second(tuning, {.socket = file}); }), HasSubstr("is not a socket"));
  EXPECT_EQ(test::read_bytes(file), "precious");
  std::filesystem::create_symlink(dead, folder / "link");
  EXPECT_THAT(error_of([&] { TuningServer second(tuning, {.socket = folder / "link"}); }), HasSubstr("not a socket"));
  EXPECT_THAT(error_of([&] { TuningServer second(tuning, {.socket = folder / std::string(120, 'x')}); }),
              HasSubstr("shorter"));
  EXPECT_THAT(error_of([&] { TuningServer second(tuning, {.socket = folder / "none/tune.sock"}); }),
              HasSubstr("No such file"));
}

TEST_F(TuningServerTest, ListensOnTheLoopbackAlone) {
  EXPECT_GT(server.port(), 0);
  asio::io_context io;
  boost::system::error_code no_ipv6;
  tcp::socket probe(io);
  if (!probe.connect({asio::ip::address_v6::loopback(), server.port()}, no_ipv6)) {
    Client client(server.port(), "::1");
    client.send("token " + kToken + "\n");
    EXPECT_EQ(client.ask("get kd"), "ok kd 10 10 10");
  }

  // Every other address of this machine refuses connections. On Linux, 127.0.0.2 always exists.
  tcp::socket other(io);
  boost::system::error_code refused;
  (void)other.connect({asio::ip::make_address("127.0.0.2"), server.port()}, refused);
  EXPECT_EQ(refused, asio::error::connection_refused);
}

TEST_F(TuningServerTest, ServesSeveralClientsThatSeeOneTuning) {
  Client a(path), b(path), c(path);
  a.send("kp 1100\n");
  EXPECT_EQ(a.line(), "ok kp 1100 1100 1100");
  EXPECT_EQ(b.ask("get kp"), "ok kp 1100 1100 1100");
  EXPECT_EQ(c.ask("gains * 2"), "ok kp 2200 2200 2200 kd 20 20 20");
  EXPECT_EQ(a.ask("kd"), "ok kd 20 20 20");
}

TEST_F(TuningServerTest, AnswersCommandsInOrderThatArriveTogetherOrInPieces) {
  Client client(path);
  client.send("kp 1\n\r\n\nkp 2\nkp");
  EXPECT_EQ(client.line(), "ok kp 1 1 1");
  EXPECT_EQ(client.line(), "ok kp 2 2 2");
  client.send(" 3\nget k");
  EXPECT_EQ(client.line(), "ok kp 3 3 3");
  client.send("p\n");
  EXPECT_EQ(client.line(), "ok kp 3 3 3");
}

TEST_F(TuningServerTest, TakesNoCommandWhoseLineDidNotEnd) {
  Client client(path);
  client.send("kd 5\nkp 20");
  client.socket().shutdown(asio::socket_base::shutdown_send);
  EXPECT_EQ(client.line(), "ok kd 5 5 5") << "complete lines before the end are answered";
  EXPECT_EQ(client.line(), "closed");
  EXPECT_EQ(tuning.wanted().gains.kp, kServed.gains.kp);
}

TEST_F(TuningServerTest, RejectsMistypedCommandsAndContinues) {
  Client client(path);
  for (const char* mistyped : {"kp 1e999", "; rm -rf /", "get ../..", "KP 5000", "kp\t5000\t5000"}) {
    const std::string answer = client.ask(mistyped);
    EXPECT_THAT(answer, StartsWith("error "));
    for (const char c : answer) EXPECT_TRUE(c >= ' ' && c <= '~');
  }
  EXPECT_THAT(client.ask(std::string(256, 'x')), StartsWith("error "));
  EXPECT_EQ(client.ask("get kp"), "ok kp 1000 1000 1000");
}

TEST_F(TuningServerTest, EndsAConnectionThatSendsInvalidLines) {
  for (const std::string& line :
       {std::string("\x00\xff\xfe\x01", 4), std::string("\x1b]0;x\x07"), std::string("kp \xc2\xb5"),
        std::string(257, 'x'), std::string(1U << 20U, 'k'), std::string("kp 5000 HTTP/1.1")}) {
    Client client(path);
    client.attack(line + "\nkp 5000\n", std::string::npos);
    const std::string answer = client.line();
    EXPECT_THAT(answer, StartsWith("error "));
    for (const char c : answer) EXPECT_TRUE(c >= ' ' && c <= '~');
    EXPECT_EQ(client.line(), "closed");
  }
  EXPECT_EQ(tuning.wanted().gains.kp, kServed.gains.kp);
}

TEST_F(TuningServerTest, IsNotHeldUpByClientsThatNeverReadOrVanish) {
  std::vector<std::unique_ptr<Client>> silent;
  for (int i = 0; i < 5; ++i) {
    silent.push_back(std::make_unique<Client>(path));
    // Send as much as the system accepts: the server stops reading and keeps no answers for this client.
    auto& socket = silent.back()->socket();
    socket.non_blocking(true);
    boost::system::error_code full;
    std::string commands;
    while (commands.size() < 65536) commands += "get\n";
    for (int n = 0; n < 64 && !full; ++n) asio::write(socket, asio::buffer(commands), full);
  }
  for (int i = 0; i < 3; ++i) {
    Client vanishing(path);
    vanishing.send("get\nget\nget\n");
    vanishing.socket().set_option(asio::socket_base::linger(true, 0));  // resets the connection instead of closing it
  }
  Client client(path);
  EXPECT_EQ(client.ask("kp 1234"), "ok kp 1234 1234 1234");
}

TEST_F(TuningServerTest, GivesANewOperatorThePlaceOfTheOneThatWasSilentLongest) {
  std::vector<std::unique_ptr<Client>> clients;
  for (int i = 0; i < 16; ++i) {
    clients.push_back(std::make_unique<Client>(path));
    EXPECT_EQ(clients.back()->ask("get kp"), "ok kp 1000 1000 1000");
  }
  EXPECT_EQ(clients[0]->ask("get kp"), "ok kp 1000 1000 1000");
  Client operator_(path);
  EXPECT_EQ(operator_.ask("kp 1234"), "ok kp 1234 1234 1234");
  EXPECT_EQ(clients[1]->line(), "closed") << "the second was silent longest";
  EXPECT_EQ(clients[0]->ask("get kp"), "ok kp 1234 1234 1234");
  EXPECT_EQ(clients[2]->ask("get kp"), "ok kp 1234 1234 1234");
}

TEST_F(TuningServerTest, AdmitsAnOperatorDespiteSilentStrangers) {
  std::vector<std::unique_ptr<Client>> silent;
  for (int i = 0; i < 200; ++i) {
    silent.push_back(std::make_unique<Client>(server.port()));
    if (i % 2 == 0) silent.back()->attack("tok", 1);
  }
  Client client(server.port());
  client.send("token " + kToken + "\n");
  EXPECT_EQ(client.ask("kp 1234"), "ok kp 1234 1234 1234");
  EXPECT_EQ(Client(path).ask("get kp"), "ok kp 1234 1234 1234");
  EXPECT_EQ(silent.front()->line(), "closed") << "the oldest had to go";
}

TEST(TuningServer, WaitsForATokenNoLongerThanItsPatience) {
  LiveTuning tuning(kServed, {});
  const TuningServer server(tuning, {.port = 0, .token = kToken, .patience = std::chrono::milliseconds(50)});
  std::unique_ptr<Client> known;
  std::string answer = "closed";
  while (answer == "closed") {  // until this process is fast enough
    known = std::make_unique<Client>(server.port());
    boost::system::error_code ignored;
    asio::write(known->socket(), asio::buffer("token " + kToken + "\nget kp\n"), ignored);
    answer = known->line();
  }
  Client silent(server.port()), slow(server.port());
  slow.attack("token ", 1);
  EXPECT_EQ(silent.line(), "closed");
  EXPECT_EQ(slow.line(), "closed");
  EXPECT_EQ(known->ask("get kp"), "ok kp 1000 1000 1000") << "an admitted client may be silent";
}

TEST(TuningServer, EndsWithItsObjectWhileClientsAreConnected) {
  const test::TempFolder folder;
  const std::string path = folder / "tune.sock";
  LiveTuning tuning(kServed, {});
  auto server = std::make_unique<TuningServer>(tuning, TuningServer::Options{path, 0, kToken});
  const std::uint16_t port = server->port();
  Client idle(path), waiting(port);
  EXPECT_EQ(idle.ask("get kp"), "ok kp 1000 1000 1000");
  server.reset();
  EXPECT_EQ(idle.line(), "closed");
  EXPECT_EQ(waiting.line(), "closed");
  EXPECT_ANY_THROW(Client{port});
  EXPECT_EQ(TuningServer(tuning, {path, port, kToken}).port(), port) << "port and path are free again at once";
}

TEST(TuningServer, SaysThatAPortIsTakenOrHasNoToken) {
  LiveTuning tuning(kServed, {});
  const TuningServer first(tuning, {.port = 0, .token = kToken});
  EXPECT_THAT(error_of([&] { TuningServer second(tuning, {.port = first.port(), .token = kToken}); }),
              AllOf(HasSubstr(std::to_string(first.port())), HasSubstr("0 for any free port")));
  EXPECT_THAT(error_of([&] { TuningServer second(tuning, {.port = 0}); }), HasSubstr("token"));
}

TEST(TuningToken, IsWrittenForItsUserAndReadFromAPrivateFile) {
  const test::TempFolder folder;
  const std::string file = folder / "token", token = new_tuning_token();
  EXPECT_EQ(token.size(), 32U);
  EXPECT_NE(token, new_tuning_token());
  write_tuning_token(token, file);
  EXPECT_EQ(std::filesystem::status(file).permissions(),
            std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  EXPECT_EQ(read_tuning_token(file), token);
  EXPECT_THAT(error_of([&] { write_tuning_token(token, file); }), HasSubstr("File exists"));

  std::filesystem::permissions(file, std::filesystem::perms(0640));
  EXPECT_THAT(error_of([&] { (void)read_tuning_token(file); }), HasSubstr("chmod 600"));
  for (const std::string& content : {std::string(), std::string("token \n"), std::string("short"),
                                     std::string(200, 'x'), std::string("sixteen letters and blanks")}) {
    const std::string bad = folder.write("bad", content);
    std::filesystem::permissions(bad, std::filesystem::perms(0600));
    EXPECT_THAT(error_of([&] { (void)read_tuning_token(bad); }), HasSubstr("contains no token")) << content;
  }
  EXPECT_THAT(error_of([&] { (void)read_tuning_token(folder.path()); }), HasSubstr("is not a readable regular file"));
}

TEST(TuningPort, IsAPortOfTheLoopbackAndNothingElse) {
  for (const char* text : {"5005", "127.0.0.1:5005", "localhost:5005", "[::1]:5005"})
    EXPECT_EQ(parse_tuning_port(text), 5005) << text;
  for (const char* text : {"0.0.0.0:5005", "192.168.1.2:5005", "[::]:5005", "::1", "65536", "-1", "", "5005x", "lab:5",
                           "127.0.0.1:", "127.0.0.1:localhost:5"})
    EXPECT_THAT(error_of([&] { (void)parse_tuning_port(text); }), HasSubstr("this machine alone")) << text;
}

}  // namespace
}  // namespace haptrace
