// SPDX-License-Identifier: GPL-2.0 OR MIT
/*
 * An I2C client with an interrupt that user space fires: the wire from a fake chip's INT pin.
 *
 *   insmod hw_fakes_irq.ko bus=0 address=0x68 kind=mpu6050
 *   echo 1 > /sys/module/hw_fakes_irq/parameters/fire
 */
#include <linux/i2c.h>
#include <linux/interrupt.h>
#include <linux/irq.h>
#include <linux/irq_work.h>
#include <linux/module.h>

static int bus;
module_param(bus, int, 0444);
static ushort address = 0x68;
module_param(address, ushort, 0444);
static char *kind = "mpu6050";
module_param(kind, charp, 0444);

static int irq;
static struct i2c_client *client;

/* generic_handle_irq wants the context of an interrupt, which irq_work has. */
static void pulse(struct irq_work *work)
{
	generic_handle_irq(irq);
}

static DEFINE_IRQ_WORK(work, pulse);

static int fire(const char *value, const struct kernel_param *parameter)
{
	if (!client)
		return -ENODEV;
	irq_work_queue(&work);
	irq_work_sync(&work);
	return 0;
}

static const struct kernel_param_ops fire_ops = { .set = fire };
module_param_cb(fire, &fire_ops, NULL, 0200);

static int __init begin(void)
{
	struct i2c_board_info info = {};
	struct i2c_adapter *adapter = i2c_get_adapter(bus);

	if (!adapter)
		return -ENODEV;
	/* No owner: the client holds its interrupt, and would hold this module, which ends by letting the client go. */
	irq = __irq_alloc_descs(-1, 0, 1, NUMA_NO_NODE, NULL, NULL);
	if (irq < 0) {
		i2c_put_adapter(adapter);
		return irq;
	}
	irq_set_chip_and_handler(irq, &dummy_irq_chip, handle_simple_irq);
	irq_set_irq_type(irq, IRQ_TYPE_EDGE_RISING);
	irq_clear_status_flags(irq, IRQ_NOREQUEST | IRQ_NOPROBE);
	strscpy(info.type, kind, sizeof(info.type));
	info.addr = address;
	info.irq = irq;
	client = i2c_new_client_device(adapter, &info);
	i2c_put_adapter(adapter);
	if (IS_ERR(client)) {
		int error = PTR_ERR(client);

		client = NULL;
		irq_free_desc(irq);
		return error;
	}
	return 0;
}

static void __exit end(void)
{
	i2c_unregister_device(client);
	irq_free_desc(irq);
}

module_init(begin);
module_exit(end);
MODULE_DESCRIPTION("An I2C client whose interrupt user space fires");
MODULE_LICENSE("GPL");
