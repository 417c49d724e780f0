// SPDX-License-Identifier: Apache-2.0
//! A master that nobody here wrote (crates.io's zencan-client), on slcan over TCP: cargo run -- HOST:PORT

use std::error::Error;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep};
use zencan_client::common::NodeId;
use zencan_client::common::lss::LssState;
use zencan_client::common::messages::{CanId, CanMessage};
use zencan_client::common::nmt::NmtState;
use zencan_client::common::node_configuration::PdoConfig;
use zencan_client::common::node_id::ConfiguredNodeId;
use zencan_client::common::pdo::{PdoCommParameter, PdoMapping};
use zencan_client::common::traits::{AsyncCanReceiver, AsyncCanSender, CanSendError};
use zencan_client::{BusManager, LssMaster};

type Done = Result<(), Box<dyn Error>>;

const DRIVE: u8 = 1;
const Y: u16 = 0x800;

#[derive(Debug)]
struct Lost(CanMessage);

impl CanSendError for Lost {
    fn into_can_message(self) -> CanMessage {
        self.0
    }
    fn message(&self) -> String {
        "the line is closed".into()
    }
}

#[derive(Debug)]
struct Sender(OwnedWriteHalf);

impl AsyncCanSender for Sender {
    type Error = Lost;
    async fn send(&mut self, message: CanMessage) -> Result<(), Lost> {
        let CanId::Std(id) = message.id else {
            return Err(Lost(message));
        };
        let kind = if message.rtr { 'r' } else { 't' };
        let mut line = format!("{kind}{id:03x}{}", message.dlc);
        if !message.rtr {
            line.extend(message.data().iter().map(|byte| format!("{byte:02x}")));
        }
        self.0
            .write_all((line + "\r").as_bytes())
            .await
            .map_err(|_| Lost(message))
    }
}

#[derive(Debug)]
struct Receiver(mpsc::UnboundedReceiver<CanMessage>);

impl AsyncCanReceiver for Receiver {
    type Error = String;
    fn try_recv(&mut self) -> Option<CanMessage> {
        self.0.try_recv().ok()
    }
    async fn recv(&mut self) -> Result<CanMessage, String> {
        self.0.recv().await.ok_or("the line is closed".into())
    }
}

fn frame(line: &str) -> Option<CanMessage> {
    let id = u16::from_str_radix(line.strip_prefix('t')?.get(..3)?, 16).ok()?;
    let text = line.get(5..)?;
    let bytes: Option<Vec<u8>> = (0..text.len())
        .step_by(2)
        .map(|i| u8::from_str_radix(text.get(i..i + 2)?, 16).ok())
        .collect();
    Some(CanMessage::new(CanId::std(id), &bytes?))
}

async fn read_lines(mut socket: OwnedReadHalf, frames: mpsc::UnboundedSender<CanMessage>) {
    let (mut rest, mut chunk) = (String::new(), [0u8; 4096]);
    while let Ok(count @ 1..) = socket.read(&mut chunk).await {
        rest += &String::from_utf8_lossy(&chunk[..count]);
        while let Some(end) = rest.find('\r') {
            let line: String = rest.drain(..=end).collect();
            if let Some(message) = frame(line.trim()) {
                let _ = frames.send(message);
            }
        }
    }
}

type Bus = BusManager<Sender>;

async fn until(what: &str, mut condition: impl AsyncFnMut() -> bool) -> Done {
    let end = Instant::now() + Duration::from_secs(5);
    while !condition().await {
        if Instant::now() > end {
            return Err(format!("not within 5 s: {what}").into());
        }
        sleep(Duration::from_millis(2)).await;
    }
    Ok(())
}

async fn status(bus: &Bus, axis: u16, mask: u16, value: u16, what: &str) -> Done {
    until(what, async || {
        let word = bus.sdo_client(DRIVE).read_u16(0x6041 + axis, 0).await;
        word.is_ok_and(|word| word & mask == value)
    })
    .await
}

async fn enable(bus: &Bus, axis: u16) -> Done {
    for (word, state) in [(6, 0x21), (7, 0x23), (15, 0x27)] {
        bus.sdo_client(DRIVE)
            .write_u16(0x6040 + axis, 0, word)
            .await?;
        status(bus, axis, 0x6F, state, &format!("state {state:x}h")).await?;
    }
    Ok(())
}

async fn transfers(bus: &Bus) -> Done {
    let mut sdo = bus.sdo_client(DRIVE);
    assert_eq!(sdo.read_identity().await?.product_code, 1);
    assert_eq!(sdo.read_device_name().await?, "Kontur"); // in segments
    println!("        software {}", sdo.read_software_version().await?);
    // Not tried: block_upload(). zencan 0.0.5 reads no answer that tells the size, as CiA 301 allows.
    let refused = sdo.read_u8(0x5000, 0).await.unwrap_err().to_string();
    assert!(refused.contains("NoSuchObject"), "{refused}");
    sdo.block_download(0x6081, 0, &20000u32.to_le_bytes())
        .await?;
    sdo.download(0x6081 + Y, 0, &20000u32.to_le_bytes()).await?;
    assert_eq!(sdo.read_u32(0x6081, 0).await?, 20000);
    Ok(())
}

async fn scan(bus: &mut Bus) -> Done {
    let nodes = bus.scan_nodes().await?;
    assert_eq!(nodes.len(), 1);
    let found = bus
        .read_pdo_config(ConfiguredNodeId::new(nodes[0].node_id).map_err(|_| "id")?)
        .await?;
    println!(
        "        RPDOs {}, TPDOs {}",
        found.rpdos.len(),
        found.tpdos.len()
    );
    assert_eq!((found.rpdos.len(), found.tpdos.len()), (5, 5));
    Ok(())
}

async fn nmt(bus: &mut Bus) -> Done {
    for state in [NmtState::Stopped, NmtState::Operational] {
        match state {
            NmtState::Stopped => bus.nmt_stop(DRIVE).await,
            _ => bus.nmt_start(DRIVE).await,
        }
        until(&format!("{state:?}"), async || {
            bus.node_list()
                .await
                .iter()
                .any(|node| node.node_id == DRIVE && node.nmt_state == Some(state))
        })
        .await?;
    }
    Ok(())
}

async fn map(bus: &Bus) -> Done {
    bus.sdo_client(DRIVE)
        .configure_rpdo(
            3,
            &PdoConfig {
                comm: PdoCommParameter {
                    valid: true,
                    rtr_disabled: false,
                    cob_id: CanId::std(0x500 + DRIVE as u16),
                    transmission_type: 254,
                },
                mappings: vec![
                    PdoMapping {
                        index: 0x6060,
                        sub: 0,
                        size: 8,
                    },
                    PdoMapping {
                        index: 0x60FF,
                        sub: 0,
                        size: 32,
                    },
                    PdoMapping {
                        index: 0x6040,
                        sub: 0,
                        size: 16,
                    },
                ],
            },
        )
        .await?;
    Ok(())
}

async fn profile_position(bus: &Bus) -> Done {
    for (axis, target) in [(0, 2_000_000), (Y, -1_000_000)] {
        bus.sdo_client(DRIVE).write_i8(0x6060 + axis, 0, 1).await?;
        bus.sdo_client(DRIVE)
            .write_i32(0x607A + axis, 0, target)
            .await?;
        enable(bus, axis).await?;
        bus.sdo_client(DRIVE)
            .write_u16(0x6040 + axis, 0, 0x1F)
            .await?;
        status(bus, axis, 0x1000, 0x1000, "set-point acknowledged").await?;
        bus.sdo_client(DRIVE)
            .write_u16(0x6040 + axis, 0, 0x0F)
            .await?;
        status(bus, axis, 0x0400, 0x0400, "target reached").await?;
        let at = bus.sdo_client(DRIVE).read_i32(0x6064 + axis, 0).await?;
        assert!((at - target).abs() < 5000, "at {at}");
    }
    Ok(())
}

/// The mode 0 and the speed are those of zeroed outputs; the controlword behind them stops.
async fn zeroed_outputs(bus: &Bus, frames: &mut Sender) -> Done {
    bus.sdo_client(DRIVE).write_i8(0x6060, 0, 3).await?;
    bus.sdo_client(DRIVE).write_i32(0x60FF, 0, -20_000).await?;
    until("a jog", async || {
        bus.sdo_client(DRIVE)
            .read_i32(0x606C, 0)
            .await
            .is_ok_and(|umps| umps < -10_000)
    })
    .await?;
    frames
        .send(CanMessage::new(CanId::std(0x500 + DRIVE as u16), &[0; 7]))
        .await
        .map_err(|e| e.message())?;
    status(bus, 0, 0x6F, 0x40, "switch on disabled").await?;
    bus.sdo_client(DRIVE).write_u16(0x6040 + Y, 0, 0).await?;
    Ok(())
}

async fn fastscan(bus: &mut Bus, second: &mut LssMaster<Sender, Receiver>) -> Done {
    let identity = bus.sdo_client(DRIVE).read_identity().await?;
    second.set_global_mode(LssState::Configuring).await;
    bus.lss_set_node_id(NodeId::Unconfigured)
        .await
        .map_err(|e| format!("{e:?}"))?;
    bus.lss_set_global_mode(LssState::Waiting).await;
    bus.nmt_reset_comms(DRIVE).await;
    sleep(Duration::from_millis(200)).await;
    let found = bus.lss_fastscan(Duration::from_millis(40)).await;
    assert_eq!(found.len(), 1);
    assert_eq!(found[0], identity);
    bus.lss_activate(found[0])
        .await
        .map_err(|e| format!("{e:?}"))?;
    bus.lss_set_node_id(NodeId::try_from(DRIVE).map_err(|_| "id")?)
        .await
        .map_err(|e| format!("{e:?}"))?;
    bus.lss_set_global_mode(LssState::Waiting).await;
    until("boot-up", async || {
        bus.sdo_client(DRIVE).read_u32(0x1000, 0).await.is_ok()
    })
    .await
}

fn report(name: &str, done: Done) -> bool {
    match &done {
        Ok(()) => println!("ok      {name}"),
        Err(error) => println!("FAILED  {name}: {error}"),
    }
    done.is_ok()
}

async fn connect(address: &str) -> Result<(Sender, Receiver), Box<dyn Error>> {
    let socket = TcpStream::connect(address).await?;
    socket.set_nodelay(true)?;
    let (read, mut write) = socket.into_split();
    write.write_all(b"C\rS8\rO\r").await?;
    let (frames, received) = mpsc::unbounded_channel();
    tokio::spawn(read_lines(read, frames));
    Ok((Sender(write), Receiver(received)))
}

#[tokio::main]
async fn main() -> Done {
    let address = std::env::args()
        .nth(1)
        .ok_or("usage: kontur-foreign-master HOST:PORT")?;
    let (sender, receiver) = connect(&address).await?;
    let (mut frames, _) = connect(&address).await?;
    let (lss_sender, lss_receiver) = connect(&address).await?;
    let mut bus = BusManager::new(sender, receiver);
    let mut lss = LssMaster::new(lss_sender, lss_receiver);
    let mut good = report(
        "SDO: expedited, segmented, block download, abort",
        transfers(&bus).await,
    );
    good &= report("scan of all nodes and their PDOs", scan(&mut bus).await);
    good &= report(
        "LSS: fastscan of a node without an id",
        fastscan(&mut bus, &mut lss).await,
    );
    good &= report("mapping of RPDO4", map(&bus).await);
    good &= report("NMT and heartbeat", nmt(&mut bus).await);
    good &= report("profile position", profile_position(&bus).await);
    good &= report(
        "zeroed outputs by RPDO stop a jog",
        zeroed_outputs(&bus, &mut frames).await,
    );
    if good {
        Ok(())
    } else {
        Err("a step failed".into())
    }
}
