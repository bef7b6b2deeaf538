// A robot or a controller on ROS 2 Humble's default middleware, Fast DDS, for tests of the wire.
//
//   peer DOMAIN THING...
//
// Things: odometry-out, int32-in, set-speed-in (a robot); odometry-in, int32-out, set-speed-out
// (a controller); nonsense-out (bytes that are no odometry, under its name). What comes in is
// printed, one line each. Outputs are sent every 100 ms. Ends with its standard input.

#include <poll.h>
#include <unistd.h>

#include <cstdio>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/publisher/qos/DataWriterQos.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/subscriber/qos/DataReaderQos.hpp>

#include "messagesPubSubTypes.h"

using namespace eprosima::fastdds::dds;
using Int32 = std_msgs::msg::dds_::Int32_;
using Int32Type = std_msgs::msg::dds_::Int32_PubSubType;
using SetSpeed = mirte_msgs::msg::dds_::SetSpeed_;
using SetSpeedType = mirte_msgs::msg::dds_::SetSpeed_PubSubType;
using Odometry = nav_msgs::msg::dds_::Odometry_;
using OdometryType = nav_msgs::msg::dds_::Odometry_PubSubType;

const std::vector<std::string> kWheels{"front_left", "front_right", "rear_right", "rear_left"};
const std::string kOdometry = "rt/mirte_base_controller/odom";

std::string MotorTopic(const std::string& wheel) { return "rt/io/motor/" + wheel + "/speed"; }

// One end of the wire: topics, and what is to be done every 100 ms.
struct Peer {
  DomainParticipant* participant;
  Publisher* publisher;
  Subscriber* subscriber;
  std::vector<std::function<void()>> inputs, outputs;

  explicit Peer(uint32_t domain)
      : participant(DomainParticipantFactory::get_instance()->create_participant(
            domain, PARTICIPANT_QOS_DEFAULT)),
        publisher(participant->create_publisher(PUBLISHER_QOS_DEFAULT)),
        subscriber(participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)) {}

  Topic* MakeTopic(const std::string& name, TypeSupport type) {
    type.register_type(participant);
    return participant->create_topic(name, type.get_type_name(), TOPIC_QOS_DEFAULT);
  }

  // Quality of service as rmw_fastrtps has it by default: reliable, volatile, keep last 10.
  template <typename Qos>
  static Qos Ros2(Qos qos) {
    qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    qos.durability().kind = VOLATILE_DURABILITY_QOS;
    qos.history().kind = KEEP_LAST_HISTORY_QOS;
    qos.history().depth = 10;
    qos.data_sharing().off();
    qos.endpoint().history_memory_policy =
        eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    return qos;
  }

  template <typename Message>
  void Out(const std::string& topic, TypeSupport type, std::function<Message()> make) {
    DataWriter* writer =
        publisher->create_datawriter(MakeTopic(topic, type), Ros2(DATAWRITER_QOS_DEFAULT));
    outputs.push_back([=] {
      Message message = make();
      writer->write(&message);
    });
  }

  template <typename Message>
  void In(const std::string& topic, TypeSupport type, std::function<void(const Message&)> print) {
    DataReader* reader =
        subscriber->create_datareader(MakeTopic(topic, type), Ros2(DATAREADER_QOS_DEFAULT));
    inputs.push_back([=] {
      Message message;
      SampleInfo info;
      while (reader->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK)
        if (info.valid_data) print(message);
    });
  }
};

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  Peer peer(std::stoul(argv[1]));
  const std::set<std::string> things(argv + 2, argv + argc);
  uint32_t count = 0;  // Of outputs so far; every value sent is derived from it.

  if (things.count("odometry-out"))
    peer.Out<Odometry>(kOdometry, TypeSupport(new OdometryType), [&count] {
      Odometry message;
      message.header().stamp().sec(1000 + count / 10);
      message.header().stamp().nanosec(count % 10 * 100000000u);
      message.header().frame_id("odom");
      message.child_frame_id("base_link");
      message.pose().pose().position().x(0.25 * count);
      message.pose().pose().position().y(-2.0);
      message.pose().pose().orientation().z(0.6);  // Yaw 2 atan2(0.6, 0.8).
      message.pose().pose().orientation().w(0.8);
      message.twist().twist().linear().x(0.5);
      message.twist().twist().linear().y(-0.25);
      message.twist().twist().angular().z(1.5);
      return message;
    });
  if (things.count("nonsense-out")) {
    auto* type = new Int32Type;
    type->setName("nav_msgs::msg::dds_::Odometry_");
    peer.Out<Int32>(kOdometry, TypeSupport(type), [] {
      Int32 message;
      message.data(-1);
      return message;
    });
  }
  if (things.count("odometry-in"))
    peer.In<Odometry>(kOdometry, TypeSupport(new OdometryType), [](const Odometry& m) {
      const auto& pose = m.pose().pose();
      const auto& twist = m.twist().twist();
      std::printf("Odometry %d %u %s %s %.17g %.17g %.17g %.17g %.17g %.17g %.17g\n",
                  m.header().stamp().sec(), m.header().stamp().nanosec(),
                  m.header().frame_id().c_str(), m.child_frame_id().c_str(), pose.position().x(),
                  pose.position().y(), pose.orientation().z(), pose.orientation().w(),
                  twist.linear().x(), twist.linear().y(), twist.angular().z());
    });
  for (size_t i = 0; i < kWheels.size(); ++i) {
    const std::string wheel = kWheels[i], topic = MotorTopic(wheel);
    const int value = 10 * (static_cast<int>(i) + 1);  // 10, 20, 30, 40, then their negatives, ...
    if (things.count("int32-in"))
      peer.In<Int32>(topic, TypeSupport(new Int32Type), [wheel](const Int32& m) {
        std::printf("Int32 %s %d\n", wheel.c_str(), m.data());
      });
    if (things.count("set-speed-in"))
      peer.In<SetSpeed>(topic, TypeSupport(new SetSpeedType), [wheel](const SetSpeed& m) {
        std::printf("SetSpeed %s %d\n", wheel.c_str(), m.speed());
      });
    if (things.count("int32-out"))
      peer.Out<Int32>(topic, TypeSupport(new Int32Type), [&count, value] {
        Int32 message;
        message.data(count % 2 ? -value : value);
        return message;
      });
    if (things.count("set-speed-out"))
      peer.Out<SetSpeed>(topic, TypeSupport(new SetSpeedType), [&count, value] {
        SetSpeed message;
        message.speed(count % 2 ? -value : value);
        return message;
      });
  }

  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  std::puts("ready");
  pollfd input{STDIN_FILENO, POLLIN, 0};
  for (int tick = 0; poll(&input, 1, 10) == 0; ++tick) {  // Every 10 ms, until standard input ends.
    for (const auto& receive : peer.inputs) receive();
    if (tick % 10 == 0) {
      for (const auto& send : peer.outputs) send();
      ++count;
    }
  }
  peer.participant->delete_contained_entities();
  DomainParticipantFactory::get_instance()->delete_participant(peer.participant);
}
