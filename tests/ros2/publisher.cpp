// A publisher of ROS 2 messages by Fast DDS, the library under rmw_fastrtps: what palpate's device is tested against.
//
// usage: publisher DOMAIN FILE [OFFSET [TIMES]]
//
// FILE holds lines "topic NAME TYPE [best-effort]" and "SECONDS NAME NUMBER...", by increasing time; type is wrench,
// bare (a wrench without a header), number (std_msgs/Float64), pose, twist, joints, frames (of "tool0", and of "other"
// beside it), array, own
// (nothing but numbers), or raw (bytes as one hexadecimal word). Or it is a recorded run: "PLAYBACK", then the number of
// topics, of each the lengths of name and type (uint32) and both, then of each message when (float64), the topic, how many
// numbers (uint32), and the numbers (float64). Once somebody listens to all topics, each message is sent at its time, and
// stamped with that time by the clock, as drivers stamp their ticks, plus OFFSET [s]. TIMES: the file is gone through so
// often. With UNICAST in the environment nothing is found by multicast, only on 127.0.0.1. Says what it has sent.
#include <chrono>
#include <cstdlib>
#include <functional>
#include <cstring>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/publisher/qos/DataWriterQos.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

using namespace eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;
using Clock = std::chrono::steady_clock;

struct Message {
    std::string kind;
    int32_t sec = 0;
    uint32_t nanosec = 0;
    std::vector<double> numbers;
    std::string raw;
};

// A type whose messages are packed by hand, by FastCDR.
class Type : public TopicDataType {
public:
    explicit Type(const std::string& name) {
        setName(name.c_str());
        m_typeSize = 4 + (2 << 20);
        m_isGetKeyDefined = false;
    }
    bool serialize(void* data, SerializedPayload_t* payload) override {
        const auto& message = *static_cast<Message*>(data);
        if (message.kind == "raw") {
            for (size_t i = 0; i + 1 < message.raw.size(); i += 2)
                payload->data[i / 2] = std::stoi(message.raw.substr(i, 2), nullptr, 16);
            payload->length = message.raw.size() / 2;
            return true;
        }
        eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(payload->data), payload->max_size);
        eprosima::fastcdr::Cdr cdr(buffer, eprosima::fastcdr::Cdr::DEFAULT_ENDIAN, eprosima::fastcdr::Cdr::DDS_CDR);
        payload->encapsulation = CDR_LE;
        cdr.serialize_encapsulation();
        if (message.kind == "array") {
            cdr << uint32_t(0) << uint32_t(0) << message.numbers;  // no dimensions, no offset
        } else if (message.kind == "own" || message.kind == "bare" || message.kind == "number") {
            for (double number : message.numbers) cdr << number;
        } else if (message.kind == "frames") {
            cdr << uint32_t(2);
            for (const char* child : {"other", "tool0"}) {
                cdr << message.sec << message.nanosec << std::string("base") << std::string(child);
                for (double number : message.numbers) cdr << (child[0] == 'o' ? -number : number);
            }
        } else {
            cdr << message.sec << message.nanosec << std::string(message.kind == "wrench" ? "ft_frame" : "base");
            if (message.kind == "joints") {
                static const std::vector<std::string> names{
                    "elbow_joint", "shoulder_lift_joint", "shoulder_pan_joint",
                    "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"};
                const auto half = message.numbers.begin() + message.numbers.size() / 2;
                cdr << names << std::vector<double>(message.numbers.begin(), half)
                    << std::vector<double>(half, message.numbers.end()) << std::vector<double>();
            } else {
                for (double number : message.numbers) cdr << number;
            }
        }
        payload->length = static_cast<uint32_t>(cdr.getSerializedDataLength());
        return true;
    }
    bool deserialize(SerializedPayload_t*, void*) override { return false; }
    std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
        const auto& message = *static_cast<Message*>(data);
        const uint32_t size = message.kind == "raw" ? message.raw.size() / 2 : 512 + 8 * message.numbers.size();
        return [size] { return size; };
    }
    void* createData() override { return new Message; }
    void deleteData(void* data) override { delete static_cast<Message*>(data); }
    bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

static const std::map<std::string, std::string> TYPES{
    {"wrench", "geometry_msgs::msg::dds_::WrenchStamped_"}, {"pose", "geometry_msgs::msg::dds_::PoseStamped_"},
    {"twist", "geometry_msgs::msg::dds_::TwistStamped_"},   {"joints", "sensor_msgs::msg::dds_::JointState_"},
    {"array", "std_msgs::msg::dds_::Float64MultiArray_"},   {"raw", "geometry_msgs::msg::dds_::WrenchStamped_"},
    {"own", "lab_msgs::msg::dds_::Load_"},                  {"bare", "geometry_msgs::msg::dds_::Wrench_"},
    {"frames", "tf2_msgs::msg::dds_::TFMessage_"},          {"number", "std_msgs::msg::dds_::Float64_"}};

using Writers = std::map<std::string, std::pair<std::string, DataWriter*>>;

static void add_topic(DomainParticipant* participant, Publisher* publisher, Writers& writers, const std::string& name,
                      const std::string& kind, bool reliable) {
    TypeSupport type(new Type(TYPES.at(kind)));
    type.register_type(participant);
    auto* topic = participant->create_topic("rt" + name, TYPES.at(kind), TOPIC_QOS_DEFAULT);
    DataWriterQos how = DATAWRITER_QOS_DEFAULT;
    how.reliability().kind = reliable ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    how.history().kind = KEEP_LAST_HISTORY_QOS;
    how.history().depth = 100;
    how.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    writers[name] = {kind, publisher->create_datawriter(topic, how)};
}

struct Entry {
    double at;
    std::string topic;
    Message message;
};

template <class T>
static T number_of(std::istream& file) {
    T value{};
    file.read(reinterpret_cast<char*>(&value), sizeof value);
    return value;
}

static std::string text_of(std::istream& file, uint32_t size) {
    std::string text(size, ' ');
    file.read(text.data(), size);
    return text;
}

static void only_unicast(DomainParticipantQos& qos) {
    eprosima::fastrtps::rtps::Locator_t own;
    eprosima::fastrtps::rtps::IPLocator::setIPv4(own, "127.0.0.1");
    qos.wire_protocol().builtin.metatrafficUnicastLocatorList.push_back(own);
    qos.wire_protocol().builtin.initialPeersList.push_back(own);
}

int main(int count, char** words) {
    const int domain = std::stoi(words[1]);
    const double offset = count > 3 ? std::stod(words[3]) : 0.0;
    const int times = count > 4 ? std::stoi(words[4]) : 1;
    DomainParticipantQos qos;
    qos.name("publisher");
    qos.transport().use_builtin_transports = false;  // as if on another computer: no shared memory
    auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    udp->interfaceWhiteList.push_back("127.0.0.1");
    qos.transport().user_transports.push_back(udp);
    if (std::getenv("UNICAST")) only_unicast(qos);
    auto* participant = DomainParticipantFactory::get_instance()->create_participant(domain, qos);
    if (!participant) return 1;
    auto* publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
    Writers writers;
    std::vector<Entry> entries;
    std::ifstream file(words[2], std::ios::binary);
    if (text_of(file, 8) == "PLAYBACK") {
        std::vector<std::string> names(number_of<uint32_t>(file));
        for (auto& name : names) {
            const auto length = number_of<uint32_t>(file), other = number_of<uint32_t>(file);
            name = text_of(file, length);
            add_topic(participant, publisher, writers, name, text_of(file, other), true);
        }
        for (double at = number_of<double>(file); file; at = number_of<double>(file)) {
            Entry entry{at, names.at(number_of<uint32_t>(file)), {}};
            entry.message.kind = writers.at(entry.topic).first;
            entry.message.numbers.resize(number_of<uint32_t>(file));
            for (double& number : entry.message.numbers) number = number_of<double>(file);
            entries.push_back(entry);
        }
    } else {
        file.seekg(0);
    }
    for (std::string line; std::getline(file, line);) {
        std::istringstream parts(line);
        std::string first, name, kind;
        parts >> first >> name;
        if (first == "topic") {
            std::string how;
            parts >> kind >> how;
            add_topic(participant, publisher, writers, name, kind, how != "best-effort");
            continue;
        }
        Entry entry{std::stod(first), name, {}};
        entry.message.kind = writers.at(name).first;
        if (entry.message.kind == "raw") parts >> entry.message.raw;
        for (std::string number; parts >> number;) entry.message.numbers.push_back(std::strtod(number.c_str(), nullptr));
        entries.push_back(entry);
    }
    std::cout << "ready" << std::endl;
    for (const auto& [name, writer] : writers) {  // nobody would hear the beginning
        PublicationMatchedStatus status;
        do {
            std::this_thread::sleep_for(std::chrono::milliseconds(2));
            writer.second->get_publication_matched_status(status);
        } while (status.current_count == 0);
    }
    std::map<std::string, long> sent;
    const auto began = Clock::now();
    const int64_t wall = std::chrono::duration_cast<std::chrono::nanoseconds>(
        std::chrono::system_clock::now().time_since_epoch()).count();
    for (int round = 0; round < times; ++round) {
        for (auto& entry : entries) {
            const double at = entry.at + round * (entries.back().at + 0.002);
            std::this_thread::sleep_until(began + std::chrono::nanoseconds(int64_t(1e9 * at)));
            const auto now = wall + int64_t(1e9 * (at + offset));
            entry.message.sec = int32_t(now / 1000000000);
            entry.message.nanosec = uint32_t(now % 1000000000);
            writers.at(entry.topic).second->write(&entry.message);
            ++sent[entry.topic];
        }
    }
    for (const auto& [topic, number] : sent) std::cout << topic << " " << number << std::endl;
    std::this_thread::sleep_for(std::chrono::milliseconds(300));  // what is on its way
    publisher->delete_contained_entities();
    participant->delete_contained_entities();
    DomainParticipantFactory::get_instance()->delete_participant(participant);
    return 0;
}
