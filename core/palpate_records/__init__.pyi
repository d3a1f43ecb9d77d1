"""A columnar reader of MCAP files, rosbag2 bags, CDR, protobuf and JSON messages, and of tables as text."""

from .bags.bag_folder import Bag as Bag
from .bags.sqlite_recovery import recover_bag as recover_bag
from .log_tables import tables_of as tables_of, texts_of as texts_of
from .mcap.mcap_file import McapFile as McapFile
from .mcap.mcap_recovery import recover_mcap as recover_mcap
from .messages.topics import Container as Container, Messages as Messages, Topic as Topic
from .recording import Survey as Survey, TopicSurvey as TopicSurvey
from .survey import survey_of as survey_of
from .tables.csv_sheet import Sheet as Sheet
