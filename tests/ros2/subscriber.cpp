// A reader of ROS 2 messages by Fast DDS, the library under rmw_fastrtps: what palpate's sink is tested against.
//
// usage: subscriber DOMAIN SECONDS "TOPIC TYPE"...
//
// TYPE is vector (geometry_msgs/Vector3Stamped), flags (diagnostic_msgs/DiagnosticArray), cloud (sensor_msgs/PointCloud2)
// or bool (std_msgs/Bool). Says "ready", then of each message one line: topic, tab, its parts with tabs between them. The
// last two types are read reliable and transient local, as rviz reads what is latched. Ends after SECONDS, or on a line at
// its standard input.
#include <chrono>
#include <cstdio>
#include <iostream>
#include <memory>
#include <mutex>
#include <poll.h>
#include <sstream>
#include <string>
#include <vector>

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/subscriber/qos/DataReaderQos.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

using namespace eprosima::fastdds::dds;
using eprosima::fastcdr::Cdr;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;

static std::string said(double number) {
    char text[40];
    std::snprintf(text, sizeof text, "%.17g", number);
    return text;
}

static void header(Cdr& cdr, std::ostream& out) {
    int32_t sec;
    uint32_t nanosec;
    std::string frame;
    cdr >> sec >> nanosec >> frame;
    out << sec << '\t' << nanosec << '\t' << frame;
}

static void vector_stamped(Cdr& cdr, std::ostream& out) {
    header(cdr, out);
    for (int i = 0; i < 3; ++i) {
        double number;
        cdr >> number;
        out << '\t' << said(number);
    }
}

static void diagnostics(Cdr& cdr, std::ostream& out) {
    header(cdr, out);
    uint32_t count;
    cdr >> count;
    for (uint32_t i = 0; i < count; ++i) {
        uint8_t level;
        std::string name, message, hardware;
        uint32_t pairs;
        cdr >> level >> name >> message >> hardware >> pairs;
        out << '\t' << int(level) << '\t' << name << '\t' << message;
        for (uint32_t k = 0; k < pairs; ++k) {
            std::string key, value;
            cdr >> key >> value;
        }
    }
}

static void cloud(Cdr& cdr, std::ostream& out) {
    header(cdr, out);
    uint32_t height, width, fields;
    cdr >> height >> width >> fields;
    std::vector<std::pair<std::string, uint32_t>> places;
    for (uint32_t i = 0; i < fields; ++i) {
        std::string name;
        uint32_t offset, count;
        uint8_t datatype;
        cdr >> name >> offset >> datatype >> count;
        if (datatype != 7 || count != 1) throw std::runtime_error("no float32");
        places.emplace_back(name, offset);
    }
    bool big, dense;
    uint32_t step, row;
    std::vector<uint8_t> data;
    cdr >> big >> step >> row >> data >> dense;
    out << '\t' << width * height;
    for (const auto& place : places) out << '\t' << place.first;
    for (uint32_t i = 0; i < width * height; ++i)
        for (const auto& place : places) {
            float number;
            std::memcpy(&number, data.data() + i * step + place.second, sizeof number);
            out << '\t' << said(number);
        }
}

static void boolean(Cdr& cdr, std::ostream& out) {
    bool value;
    cdr >> value;
    out << value;
}

struct Kind {
    std::string name;
    void (*decode)(Cdr&, std::ostream&);
    bool latched;
};
static const std::map<std::string, Kind> KINDS{
    {"vector", {"geometry_msgs::msg::dds_::Vector3Stamped_", vector_stamped, false}},
    {"flags", {"diagnostic_msgs::msg::dds_::DiagnosticArray_", diagnostics, false}},
    {"cloud", {"sensor_msgs::msg::dds_::PointCloud2_", cloud, true}},
    {"bool", {"std_msgs::msg::dds_::Bool_", boolean, true}}};

// Messages become the text that is said of them.
class Type : public TopicDataType {
public:
    explicit Type(const Kind& kind) : kind_(kind) {
        setName(kind.name.c_str());
        m_typeSize = 4 + (4 << 20);
        m_isGetKeyDefined = false;
    }
    bool serialize(void*, SerializedPayload_t*) override { return false; }
    bool deserialize(SerializedPayload_t* payload, void* data) override {
        eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(payload->data), payload->length);
        Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
        std::ostringstream out;
        try {
            cdr.read_encapsulation();
            kind_.decode(cdr, out);
        } catch (const std::exception& error) {
            out.str(std::string("damaged: ") + error.what());
        }
        *static_cast<std::string*>(data) = out.str();
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void*) override {
        return [] { return uint32_t(0); };
    }
    void* createData() override { return new std::string; }
    void deleteData(void* data) override { delete static_cast<std::string*>(data); }
    bool getKey(void*, InstanceHandle_t*, bool) override { return false; }

private:
    Kind kind_;
};

class Listener : public DataReaderListener {
public:
    explicit Listener(const std::string& topic) : topic_(topic) {}
    void on_data_available(DataReader* reader) override {
        std::string text;
        SampleInfo info;
        while (reader->take_next_sample(&text, &info) == ReturnCode_t::RETCODE_OK) {
            if (!info.valid_data) continue;
            std::lock_guard<std::mutex> lock(mutex());
            std::cout << topic_ << '\t' << text << std::endl;
        }
    }

private:
    static std::mutex& mutex() {
        static std::mutex one;
        return one;
    }
    std::string topic_;
};

int main(int count, char** words) {
    DomainParticipantQos qos;
    qos.name("subscriber");
    qos.transport().use_builtin_transports = false;
    auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    udp->interfaceWhiteList.push_back("127.0.0.1");
    qos.transport().user_transports.push_back(udp);
    auto* participant = DomainParticipantFactory::get_instance()->create_participant(std::stoi(words[1]), qos);
    if (!participant) return 1;
    auto* subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
    std::vector<std::unique_ptr<Listener>> listeners;
    for (int i = 3; i < count; ++i) {
        std::istringstream parts(words[i]);
        std::string name, kind_name;
        parts >> name >> kind_name;
        const Kind& kind = KINDS.at(kind_name);
        TypeSupport type(new Type(kind));
        type.register_type(participant);
        auto* topic = participant->create_topic("rt" + name, kind.name, TOPIC_QOS_DEFAULT);
        DataReaderQos how = DATAREADER_QOS_DEFAULT;
        how.reliability().kind = RELIABLE_RELIABILITY_QOS;
        if (kind.latched) how.durability().kind = TRANSIENT_LOCAL_DURABILITY_QOS;
        how.history().kind = KEEP_LAST_HISTORY_QOS;
        how.history().depth = 1000;
        how.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
        listeners.push_back(std::make_unique<Listener>(name));
        subscriber->create_datareader(topic, how, listeners.back().get());
    }
    std::cout << "ready" << std::endl;
    pollfd input{0, POLLIN, 0};
    poll(&input, 1, int(1000 * std::stod(words[2])));
    subscriber->delete_contained_entities();
    participant->delete_contained_entities();
    DomainParticipantFactory::get_instance()->delete_participant(participant);
    return 0;
}
